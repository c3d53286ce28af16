#include "client/view/render/gl_state.h"

#include <epoxy/gl.h>

#include <initializer_list>

namespace palpate::view {

void ResetState() {
  for (const GLenum switched_on :
       {GL_BLEND, GL_COLOR_LOGIC_OP, GL_CULL_FACE, GL_DEPTH_CLAMP, GL_DEPTH_TEST,
        GL_FRAMEBUFFER_SRGB, GL_POLYGON_OFFSET_FILL, GL_PRIMITIVE_RESTART, GL_RASTERIZER_DISCARD,
        GL_SCISSOR_TEST, GL_STENCIL_TEST}) {
    glDisable(switched_on);
  }
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glDepthRange(0.0, 1.0);
  glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  glBindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
  for (const GLenum pixels : {GL_UNPACK_ROW_LENGTH, GL_UNPACK_IMAGE_HEIGHT, GL_UNPACK_SKIP_PIXELS,
                              GL_UNPACK_SKIP_ROWS, GL_UNPACK_SKIP_IMAGES, GL_UNPACK_SWAP_BYTES}) {
    glPixelStorei(pixels, 0);
  }
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  // A sampler object of other code would override how textures are read.
  for (GLuint unit = 0; unit < 8; ++unit) glBindSampler(unit, 0);
}

bool TakeErrors() {
  bool any = false;
  while (glGetError() != GL_NO_ERROR) any = true;
  return any;
}

unsigned NewTexture(unsigned format, const ImageSize& size) {
  GLuint texture = 0;
  glGenTextures(1, &texture);
  glBindTexture(GL_TEXTURE_2D, texture);
  glTexStorage2D(GL_TEXTURE_2D, 1, format, size.width, size.height);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  return texture;
}

void BindTexture(int unit, unsigned kind, unsigned texture) {
  glActiveTexture(static_cast<GLenum>(GL_TEXTURE0 + unit));
  glBindTexture(kind, texture);
}

}  // namespace palpate::view
