// Means of the voxels around each voxel, equal bit by bit to openvdb::tools::Filter. Works in a
// dense array, ten times as fast as in a tree. Tests compare the two.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate {

class MeanFilter {
 public:
  // Holds `size` voxels. The voxels around them always have the value `around`.
  MeanFilter(const Vec3i& size, int width, float around);

  // Points to voxel (x, y, 0), followed by the voxels along z.
  float* Row(int x, int y) { return values_.data() + Place(x, y); }
  const float* Row(int x, int y) const { return values_.data() + Place(x, y); }

  // Computes one mean of (2·width + 1)³ voxels. `check` is called often; it may throw.
  void Run(const std::function<void()>& check);

 private:
  std::size_t Place(int x, int y) const {
    return static_cast<std::size_t>(x + width_) * stride_x_ +
           static_cast<std::size_t>(y + width_) * stride_y_ + static_cast<std::size_t>(width_);
  }
  void Pass(std::size_t stride, const std::function<void()>& check);

  const Vec3i size_;
  const int width_;
  const std::size_t stride_y_;
  const std::size_t stride_x_;
  std::vector<float> values_;  // the voxels, with `width` voxels around them
  std::vector<float> next_;
};

}  // namespace palpate
