// A colour map on the graphics card, and shader code to read it. So a value has the same colour on
// a cut and in a slice.
//
// Threads: that of the current OpenGL 4.3 context. Errors: none.
#pragma once

#include <optional>

#include "client/view/scene/color_map.h"

namespace palpate::view {

// Two GLSL functions:
// - vec3 ColorAt(sampler2D table, float share): share 0 is the first colour, 1 the last
// - float ShareOf(float above_min, float range): the place of a value in a window of values.
//   above_min: the value less the window's least value. A window of range 0 is a step.
extern const char* const kShaderColors;

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
