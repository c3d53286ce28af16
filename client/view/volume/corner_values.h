// The values at the 9³ corners of a cell brick, as the graphics card stores them.
//
// Threads: pure.
#pragma once

#include <cstddef>

#include "client/view/volume/view_volume.h"

namespace palpate::view {

inline constexpr int kCornerEdge = kBrickEdge + 1;
inline constexpr int kCorners = kCornerEdge * kCornerEdge * kCornerEdge;

// Where corners go: corner (i, j, k) to first[i image + j row + k]. Defined for the types of
// LeafType.
template <class T>
struct CornerTarget {
  T* first = nullptr;
  std::ptrdiff_t row = kCornerEdge;
  std::ptrdiff_t image = kCornerEdge * kCornerEdge;

  // Copies the corners of a cell brick. Its voxels must have come (ViewVolume::HasCome). Returns
  // false if T does not hold a value; the target is then partly written.
  bool Copy(const ViewVolume& volume, const Vec3i& cell_brick) const;
  // The same for the first corners of the cell bricks of a block: a coarse picture of the block.
  // The last ones are those of the next block.
  bool CopyCoarse(const ViewVolume& volume, const Vec3i& block) const;
};

}  // namespace palpate::view
