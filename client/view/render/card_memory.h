// Memory on the graphics card: slots for bricks, and growing arrays.
#pragma once

#include <cstddef>
#include <cstdint>

#include "client/view/volume/corner_values.h"
#include "common/bricks/leaf_type.h"

namespace palpate::view {

// Slots for cell bricks on the graphics card: a 3-D texture in which each slot holds the values at
// 9³ corners, in a volume's own type.
//
// Layout: slots lie 64 to a row, 64 rows to a layer. Within a slot, texel (k, j, i) is corner
// (i, j, k). Integer types are integer textures (R8UI, R16I, R16UI); float is R32F.
//
// Threads: that of the current OpenGL 4.3 context. Its state must be as ResetState leaves it.
// Errors: none but Allocate's result.
class BrickAtlas {
 public:
  static constexpr std::uint32_t kRow = 64;

  BrickAtlas() = default;
  ~BrickAtlas() { Release(); }
  BrickAtlas(const BrickAtlas&) = delete;
  BrickAtlas& operator=(const BrickAtlas&) = delete;

  void Release();
  // Makes room for at least so many slots; what the slots held is lost. Returns false if the
  // context or its memory does not hold so many; there are none then.
  bool Allocate(LeafType type, std::uint32_t slots);
  std::uint32_t capacity() const { return capacity_; }
  LeafType type() const { return type_; }
  static std::size_t SlotBytes(LeafType type) { return kCorners * VoxelBytes(type); }

  // Uploads neighbouring slots of one row. Values lie as in the texture, without gaps.
  void Upload(std::uint32_t first, std::uint32_t count, const void* values) const;

  unsigned texture() const { return texture_; }

 private:
  LeafType type_ = LeafType::kFloat;
  std::uint32_t capacity_ = 0;
  unsigned texture_ = 0;
};

// A growing array on the graphics card, which shaders read as a buffer texture.
//
// Threads: that of the current OpenGL 4.3 context. Errors: none but Reserve's result.
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
