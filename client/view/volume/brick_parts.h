// Statistics of parts of a typed brick, in loops over its own type.
//
// Threads: pure.
#pragma once

#include <vector>

#include "client/view/volume/histogram.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

// The range of a brick's voxels from `first` to before `end` along each axis. `first` is 0 or 7.
ValueRange RangeOfPart(const TypedBrick& brick, const Vec3i& first, const Vec3i& end);

// Counts voxels of integer types by value, and adds the sums to a histogram at the end: a voxel
// then costs one addition.
class VoxelCounts {
 public:
  explicit VoxelCounts(Histogram& histogram) : histogram_(histogram) {}
  ~VoxelCounts();
  VoxelCounts(const VoxelCounts&) = delete;
  VoxelCounts& operator=(const VoxelCounts&) = delete;

  // The voxels before `end` along each axis.
  void Add(const TypedBrick& brick, const Vec3i& end) { Count<1>(brick, end); }
  void Remove(const TypedBrick& brick, const Vec3i& end) { Count<-1>(brick, end); }

 private:
  template <int kSign>
  void Count(const TypedBrick& brick, const Vec3i& end);
  // From -2^15 to 2^16 - 1.
  static constexpr int kLeast = -(1 << 15);

  Histogram& histogram_;
  std::vector<std::int64_t> counts_;  // empty: no integers yet
};

}  // namespace palpate::view
