// Slots for cell bricks on the graphics card: a 3-D texture in which each slot holds the values at
// 9³ corners, in a volume's own type.
//
// Layout: slots lie 64 to a row, 64 rows to a layer. Within a slot, texel (k, j, i) is corner
// (i, j, k). Integer types are integer textures (R8UI, R16I, R16UI); float is R32F.
//
// Threads: that of the current OpenGL 4.3 context. Its state must be as ResetState leaves it.
// Errors: none but Allocate's result.
#pragma once

#include <cstddef>
#include <cstdint>

#include "client/view/volume/corner_values.h"
#include "common/bricks/leaf_type.h"

namespace palpate::view {

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

}  // namespace palpate::view
