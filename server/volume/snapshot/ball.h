// A ball at the stylus's tip, on voxels of some shape.
//
// Frames: I voxels, D device (mm). Threads: plain values, pure functions. Errors: none.
#pragma once

#include <utility>

#include "common/felt_tool/tool_size.h"  // kLeastBallVoxels, kMostBallVoxels
#include "common/geometry/geometry.h"

namespace palpate {

struct Ball {
  double radius_mm = 0.0;                     // > 0
  Mat3 device_from_index = Mat3::Identity();  // mm per voxel; a rotation makes no difference
  bool is_least = false;                      // feels the least value within it, not the greatest
  friend bool operator==(const Ball&, const Ball&) = default;
};

// The least and the greatest radius on voxels of this shape, in mm.
std::pair<double, double> BallRange(const Mat3& device_from_index);
// Whether its field can be made, in bounded time.
bool CanBe(const Ball& ball);

}  // namespace palpate
