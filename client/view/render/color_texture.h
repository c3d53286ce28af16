// A colour map on the graphics card, and how shaders read it: the same value has the
// same colour on a cut and in a slice.
//
// Threads: that of the current OpenGL 4.3 context. Errors: none.
#pragma once

#include <optional>

#include "client/view/scene/color_map.h"

namespace palpate::view {

// GLSL: vec3 ColorAt(sampler2D table, float share), from 0, the first colour, to 1, the
// last; float ShareOf(float above_min, float range), where in a window of values a value
// is, by what it is above the window's least value. A window of range 0 is a step.
extern const char* const kShaderColors;

class ColorTexture {
 public:
  ColorTexture();
  ~ColorTexture();
  ColorTexture(const ColorTexture&) = delete;
  ColorTexture& operator=(const ColorTexture&) = delete;

  // Uploads it where it shows another. Binds it.
  void Show(ColorMap map);
  unsigned name() const { return name_; }

 private:
  unsigned name_ = 0;
  std::optional<ColorMap> shown_;
};

}  // namespace palpate::view
