// Scales a volume's values for computations on a graphics card: by a power of two, so that the
// largest is near 2^32 for any unit. The squares of the values then fit a float, and so do the
// squares of differences 10^-28 times as large.
//
// A power of two changes no digit, so the order of values stays the same. Only values 10^47 times
// smaller than the largest are lost. Values beyond the volume's first range are limited to 2^50.
//
// Threads: plain values, pure.
#pragma once

#include "common/geometry/geometry.h"

namespace palpate::view {

class ValueScale {
 public:
  ValueScale() = default;
  // For values between the two, in data units.
  ValueScale(double min, double max);

  // The power of two.
  double factor() const { return factor_; }
  double Scaled(double value) const;
  float Scaled(float value) const { return static_cast<float>(Scaled(static_cast<double>(value))); }
  // Splits a value that is compared with others. The first part is the greatest scaled float that
  // is not above the value. The second part is the rest, as a float that is not above it. A float
  // is above the value exactly if it is above the first part. The difference to both parts together
  // is as exact as with doubles.
  Eigen::Vector2d Split(double value) const;

 private:
  double factor_ = 1.0;
};

}  // namespace palpate::view
