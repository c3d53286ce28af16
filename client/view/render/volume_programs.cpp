#include "client/view/render/volume_programs.h"

#include <epoxy/gl.h>

#include "client/shading/shading.h"

namespace palpate::view {
namespace {

constexpr const char* kAtlasSamplers[] = {"usampler3D", "isampler3D", "usampler3D", "sampler3D"};

void Bind(int unit, GLenum kind, unsigned texture) {
  glActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
  glBindTexture(kind, texture);
}

}  // namespace

const ShaderProgram& VolumePrograms::Use(const BrickCache& volume) {
  const LeafType type = volume.atlas().type();
  const auto number = static_cast<std::size_t>(type);
  std::unique_ptr<ShaderProgram>& program = programs_[number];
  if (!program) {
    program = std::make_unique<ShaderProgram>(
        "#version 430 core\n#define ATLAS " + std::string(kAtlasSamplers[number]) + "\n" +
        shading::kVolumeDesktop + shading::kCell + fragment_source_);
  }
  Bind(3, GL_TEXTURE_BUFFER, volume.slots().texture());
  Bind(2, GL_TEXTURE_BUFFER, volume.ranges().texture());
  Bind(1, GL_TEXTURE_BUFFER, volume.blocks().texture());
  Bind(0, GL_TEXTURE_3D, volume.atlas().texture());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, volume.marks().buffer());
  program->Use();
  program->Set("atlas", 0);
  program->Set("blocks", 1);
  program->Set("ranges", 2);
  program->Set("slots", 3);
  // Floats are stored scaled. A factor that is a power of two changes no digit.
  program->Set("texel_factor",
               type == LeafType::kFloat ? 1.0 : static_cast<double>(volume.scale().factor()));
  program->Set("background", static_cast<double>(volume.background()));
  program->Set("block_count", volume.block_count());
  program->Set("cells", Vec3i(volume.size() + Vec3i::Ones()));
  return *program;
}

}  // namespace palpate::view
