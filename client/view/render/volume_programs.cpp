#include "client/view/render/volume_programs.h"

#include <epoxy/gl.h>

#include <utility>

#include "client/shading/shading.h"
#include "client/view/render/gl_state.h"

namespace palpate::view {
namespace {

constexpr const char* kAtlasSamplers[] = {"usampler3D", "isampler3D", "usampler3D", "sampler3D"};

}  // namespace

VolumePrograms::VolumePrograms(std::string fragment_source)
    : fragment_source_(std::move(fragment_source)), colors_(NewTexture(GL_RGBA8, {256, 1})) {}

VolumePrograms::~VolumePrograms() { glDeleteTextures(1, &colors_); }

const ShaderProgram& VolumePrograms::Use(const BrickCache& volume, ColorMap map) {
  const LeafType type = volume.atlas().type();
  const auto number = static_cast<std::size_t>(type);
  std::unique_ptr<ShaderProgram>& program = programs_[number];
  if (!program) {
    program = std::make_unique<ShaderProgram>(
        "#version 430 core\n#define ATLAS " + std::string(kAtlasSamplers[number]) + "\n" +
        shading::kVolumeDesktop + shading::kCell + fragment_source_);
  }
  BindTexture(4, GL_TEXTURE_2D, colors_);
  if (shown_ != map) {
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 256, 1, GL_RGBA, GL_UNSIGNED_BYTE,
                    ColorTable(map).data());
    shown_ = map;
  }
  BindTexture(3, GL_TEXTURE_BUFFER, volume.slots().texture());
  BindTexture(2, GL_TEXTURE_BUFFER, volume.ranges().texture());
  BindTexture(1, GL_TEXTURE_BUFFER, volume.blocks().texture());
  BindTexture(0, GL_TEXTURE_3D, volume.atlas().texture());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, volume.marks().buffer());
  program->Use();
  program->Set("atlas", 0);
  program->Set("blocks", 1);
  program->Set("ranges", 2);
  program->Set("slots", 3);
  program->Set("color_map", 4);
  // Floats are stored scaled. A factor that is a power of two changes no digit.
  program->Set("texel_factor", type == LeafType::kFloat ? 1.0 : volume.scale().factor());
  program->Set("background", static_cast<double>(volume.background()));
  program->Set("block_count", volume.block_count());
  program->Set("cells", volume.size() + Vec3i::Ones());
  return *program;
}

}  // namespace palpate::view
