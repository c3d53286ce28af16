// The programs that read a volume from the tables of a brick cache, for each type of its values.
// Their frame is P of shading.h.
//
// Threads: those of BrickCache. Errors: those of ShaderProgram.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <utility>

#include "client/view/render/brick_cache.h"
#include "client/view/render/shader_program.h"

namespace palpate::view {

// The texture units of the volume: 0 to 3. Further textures begin here.
inline constexpr int kFirstFreeUnit = 4;
// The shader storage buffer of the marks: 0. Further buffers begin here.
inline constexpr unsigned kFirstFreeBuffer = 1;

class VolumePrograms {
 public:
  // `fragment_source` comes after kVolumeDesktop and kCell of shading.h.
  explicit VolumePrograms(std::string fragment_source)
      : fragment_source_(std::move(fragment_source)) {}

  // Makes the program for this volume the one in use, and binds the volume to it.
  const ShaderProgram& Use(const BrickCache& volume);

 private:
  std::string fragment_source_;
  std::array<std::unique_ptr<ShaderProgram>, 4> programs_;  // by LeafType
};

}  // namespace palpate::view
