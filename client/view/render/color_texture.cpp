#include "client/view/render/color_texture.h"

#include <epoxy/gl.h>

namespace palpate::view {

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
