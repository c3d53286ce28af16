// A colour map on the graphics card. colors.glsl of client/shading reads it.
//
// Threads: that of the current OpenGL 4.3 context. Errors: none.
#pragma once

#include <optional>

#include "client/view/scene/color_map.h"

namespace palpate::view {

class ColorTexture {
 public:
  ColorTexture();
  ~ColorTexture();
  ColorTexture(const ColorTexture&) = delete;
  ColorTexture& operator=(const ColorTexture&) = delete;

  // Uploads the map if another one is shown. Binds the texture.
  void Show(ColorMap map);
  unsigned name() const { return name_; }

 private:
  unsigned name_ = 0;
  std::optional<ColorMap> shown_;
};

}  // namespace palpate::view
