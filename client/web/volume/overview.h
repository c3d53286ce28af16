// The volume at a low resolution: means of blocks of factor³ voxels, in the volume's type.
//
// Frame: I, voxel indices. Block (i, j, k) covers the voxels factor i to factor i + factor - 1
// along x, and likewise along y and z, so its centre is at index factor i + (factor - 1) / 2. It is
// at (i nj + j) nk + k. Blocks at the end of the lattice are means of the voxels within it. Means
// of integers are rounded. Values in data units. Threads: one.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/bricks/leaf_type.h"
#include "common/geometry/geometry.h"

namespace palpate::web {

class Overview {
 public:
  static constexpr int kMostBlocks = 128;  // along an axis

  Overview() = default;
  // Of a lattice of `size` voxels whose voxels have the value `background`. The factor is the
  // smallest power of two, from `least_factor` on, with at most kMostBlocks blocks along every
  // axis.
  Overview(const Vec3i& size, float background, int least_factor);

  int factor() const { return factor_; }
  const Vec3i& size() const { return size_; }  // blocks

  // The voxels of group.h's group (a, b, c).
  void PutGroup(const Vec3i& group, LeafType type, std::string_view bytes);
  void PutConstantGroup(const Vec3i& group, float value);
  // The means in this type, which must hold the volume's voxels. Only changed blocks are computed
  // again, unless the type is another one.
  const std::string& Bytes(LeafType type);

 private:
  // Sums are kept of cells, which are the blocks, or groups if blocks are larger than these.
  template <class Sum>
  void PutCells(const Vec3i& group, Sum sum);
  double Mean(const Vec3i& block) const;
  void Compute(const Vec3i& begin, const Vec3i& end);

  Vec3i lattice_ = Vec3i::Zero();
  int factor_ = 1;
  int cell_ = 1;  // voxels along an axis
  Vec3i size_ = Vec3i::Zero();
  Vec3i cells_ = Vec3i::Zero();
  std::vector<double> sums_;  // of cells
  LeafType type_ = LeafType::kUint8;
  std::string bytes_;           // empty: never computed
  std::vector<Vec3i> changed_;  // groups whose blocks in bytes_ are old
};

}  // namespace palpate::web
