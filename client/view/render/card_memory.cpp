#include "client/view/render/card_memory.h"

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

namespace {

GLsizeiptr Bytes(std::size_t bytes) { return static_cast<GLsizeiptr>(bytes); }

}  // namespace

void CardBuffer::Release() {
  if (buffer_ != 0) glDeleteBuffers(1, &buffer_);
  if (texture_ != 0) glDeleteTextures(1, &texture_);
  buffer_ = texture_ = 0;
  capacity_ = 0;
}

bool CardBuffer::Reserve(std::size_t entries) {
  if (entries <= capacity_) return true;
  GLint most = 0;
  glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &most);
  if (entries > static_cast<std::size_t>(most)) return false;
  const std::size_t capacity =
      std::min(std::max(entries, capacity_ + capacity_ / 2), static_cast<std::size_t>(most));
  GLuint buffer = 0;
  glGenBuffers(1, &buffer);
  glBindBuffer(GL_COPY_WRITE_BUFFER, buffer);
  TakeErrors();
  glBufferData(GL_COPY_WRITE_BUFFER, Bytes(capacity * entry_bytes_), nullptr, GL_DYNAMIC_DRAW);
  if (TakeErrors()) {
    glDeleteBuffers(1, &buffer);
    return false;
  }
  if (buffer_ != 0) {
    glBindBuffer(GL_COPY_READ_BUFFER, buffer_);
    glCopyBufferSubData(GL_COPY_READ_BUFFER, GL_COPY_WRITE_BUFFER, 0, 0, Bytes(bytes()));
    glDeleteBuffers(1, &buffer_);
  }
  buffer_ = buffer;
  capacity_ = capacity;
  if (texture_ == 0) glGenTextures(1, &texture_);
  glBindTexture(GL_TEXTURE_BUFFER, texture_);
  glTexBuffer(GL_TEXTURE_BUFFER, format_, buffer_);
  return true;
}

void CardBuffer::Write(std::size_t first, std::size_t count, const void* entries) const {
  glBindBuffer(GL_COPY_WRITE_BUFFER, buffer_);
  glBufferSubData(GL_COPY_WRITE_BUFFER, Bytes(first * entry_bytes_), Bytes(count * entry_bytes_),
                  entries);
}

void CardBuffer::Read(std::size_t count, void* entries) const {
  if (count == 0) return;
  glBindBuffer(GL_COPY_READ_BUFFER, buffer_);
  glGetBufferSubData(GL_COPY_READ_BUFFER, 0, Bytes(count * entry_bytes_), entries);
}

void CardBuffer::Clear() const {
  if (buffer_ == 0) return;
  glBindBuffer(GL_COPY_WRITE_BUFFER, buffer_);
  glClearBufferData(GL_COPY_WRITE_BUFFER, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, nullptr);
}

}  // namespace palpate::view
