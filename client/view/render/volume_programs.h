// The programs that read a volume from the tables of a brick cache, for each type of its values,
// and show values in a colour map. Their frame is P of shading.h.
//
// Threads: those of BrickCache. Errors: those of ShaderProgram.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "client/view/drawing/color_map.h"
#include "client/view/render/brick_cache.h"
#include "client/view/render/shader_program.h"

namespace palpate::view {

// The shader storage buffer of the marks: 0. Further buffers begin here.
inline constexpr unsigned kFirstFreeBuffer = 1;

class VolumePrograms {
 public:
  // `fragment_source` comes after kVolumeDesktop and kCell of shading.h. Its colours are in
  // `color_map`, as ColorAt of kColors reads them. Texture units 0 to 4 are taken.
  explicit VolumePrograms(std::string fragment_source);
  ~VolumePrograms();
  VolumePrograms(const VolumePrograms&) = delete;
  VolumePrograms& operator=(const VolumePrograms&) = delete;

  // Makes the program for this volume the one in use, and binds the volume and the map to it.
  const ShaderProgram& Use(const BrickCache& volume, ColorMap map);

 private:
  std::string fragment_source_;
  std::array<std::unique_ptr<ShaderProgram>, 4> programs_;  // by LeafType
  unsigned colors_;                                         // a texture
  std::optional<ColorMap> shown_;                           // in colors_
};

}  // namespace palpate::view
