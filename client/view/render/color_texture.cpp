#include "client/view/render/color_texture.h"

#include <epoxy/gl.h>

namespace palpate::view {

const char* const kShaderColors = R"(
vec3 ColorAt(sampler2D table, float share) {
  float entry = clamp(share, 0.0, 1.0) * 255.0;
  int below = min(int(entry), 254);
  return mix(texelFetch(table, ivec2(below, 0), 0).rgb,
             texelFetch(table, ivec2(below + 1, 0), 0).rgb, entry - float(below));
}

float ShareOf(float above_min, float range) {
  return range != 0.0 ? above_min / range : step(0.0, above_min);
}
)";

ColorTexture::ColorTexture() {
  glGenTextures(1, &name_);
  glBindTexture(GL_TEXTURE_2D, name_);
  glTexStorage2D(GL_TEXTURE_2D, 1, GL_RGBA8, 256, 1);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
}

ColorTexture::~ColorTexture() { glDeleteTextures(1, &name_); }

void ColorTexture::Show(ColorMap map) {
  glBindTexture(GL_TEXTURE_2D, name_);
  if (shown_ == map) return;
  glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, 256, 1, GL_RGBA, GL_UNSIGNED_BYTE,
                  ColorTable(map).data());
  shown_ = map;
}

}  // namespace palpate::view
