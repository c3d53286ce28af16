// A growing array on the graphics card, which shaders read as a buffer texture.
//
// Threads: that of the current OpenGL 4.3 context. Errors: none but Reserve's result.
#pragma once

#include <cstddef>

namespace palpate::view {

class CardBuffer {
 public:
  // Of the buffer texture, such as GL_RG32F; and bytes of an entry.
  CardBuffer(unsigned format, std::size_t entry_bytes)
      : format_(format), entry_bytes_(entry_bytes) {}
  ~CardBuffer() { Release(); }
  CardBuffer(const CardBuffer&) = delete;
  CardBuffer& operator=(const CardBuffer&) = delete;

  void Release();
  // Keeps what was written. Returns false if the context or its memory does not hold so many; the
  // buffer is then unchanged.
  bool Reserve(std::size_t entries);
  std::size_t bytes() const { return capacity_ * entry_bytes_; }

  void Write(std::size_t first, std::size_t count, const void* entries) const;
  void Read(std::size_t count, void* entries) const;
  // All entries become 0.
  void Clear() const;

  unsigned buffer() const { return buffer_; }
  unsigned texture() const { return texture_; }

 private:
  unsigned format_;
  std::size_t entry_bytes_;
  std::size_t capacity_ = 0;
  unsigned buffer_ = 0;
  unsigned texture_ = 0;
};

}  // namespace palpate::view
