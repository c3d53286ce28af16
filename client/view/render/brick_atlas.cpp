#include "client/view/render/brick_atlas.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <iterator>

#include "client/view/render/gl_state.h"

namespace palpate::view {
namespace {

struct Format {
  GLenum internal;
  GLenum external;
  GLenum type;
};

constexpr Format kAtlasFormats[] = {{GL_R8UI, GL_RED_INTEGER, GL_UNSIGNED_BYTE},
                                    {GL_R16I, GL_RED_INTEGER, GL_SHORT},
                                    {GL_R16UI, GL_RED_INTEGER, GL_UNSIGNED_SHORT},
                                    {GL_R32F, GL_RED, GL_FLOAT}};  // by LeafType
static_assert(std::size(kAtlasFormats) == std::size(kLeafTypes));

const Format& FormatOf(LeafType type) { return kAtlasFormats[static_cast<std::size_t>(type)]; }

std::uint32_t Parts(std::uint32_t whole, std::uint32_t part) { return (whole + part - 1) / part; }

}  // namespace

void BrickAtlas::Release() {
  if (texture_ != 0) glDeleteTextures(1, &texture_);
  texture_ = 0;
  capacity_ = 0;
}

bool BrickAtlas::Allocate(LeafType type, std::uint32_t slots) {
  Release();
  type_ = type;
  const std::uint32_t rows = std::min(Parts(slots, kRow), kRow);
  const std::uint32_t layers = Parts(slots, kRow * kRow);
  GLint most = 0;
  glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &most);
  if (static_cast<GLint>(std::max(layers, kRow) * kCornerEdge) > most) return false;
  glGenTextures(1, &texture_);
  glBindTexture(GL_TEXTURE_3D, texture_);
  glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  TakeErrors();
  glTexStorage3D(GL_TEXTURE_3D, 1, FormatOf(type).internal,
                 static_cast<GLsizei>(kRow * kCornerEdge), static_cast<GLsizei>(rows * kCornerEdge),
                 static_cast<GLsizei>(layers * kCornerEdge));
  if (TakeErrors()) {
    Release();
    return false;
  }
  capacity_ = rows * kRow * layers;
  return true;
}

void BrickAtlas::Upload(std::uint32_t first, std::uint32_t count, const void* values) const {
  const Format& format = FormatOf(type_);
  glBindTexture(GL_TEXTURE_3D, texture_);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  glTexSubImage3D(GL_TEXTURE_3D, 0, static_cast<GLint>(first % kRow * kCornerEdge),
                  static_cast<GLint>(first / kRow % kRow * kCornerEdge),
                  static_cast<GLint>(first / (kRow * kRow) * kCornerEdge),
                  static_cast<GLsizei>(count * kCornerEdge), kCornerEdge, kCornerEdge,
                  format.external, format.type, values);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
}

}  // namespace palpate::view
