#include "client/view/render/card_buffer.h"

#include <epoxy/gl.h>

#include <algorithm>

#include "client/view/render/gl_state.h"

namespace palpate::view {
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
