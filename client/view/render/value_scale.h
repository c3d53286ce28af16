// How a volume's values are turned into numbers with which a graphics card can do
// sums: times a power of two, so that the largest is near 2^32 whatever the data's unit.
// Their squares then fit a float, and so do those of differences 10^-28 times as large.
//
// A power of two changes no digit: what is above a value, equal to it or between is so
// afterwards as well. Only what is 10^47 times smaller than the largest is lost. Values
// beyond those that the volume began with are limited to 2^50.
//
// Threads: plain values, pure.
#pragma once

#include "common/geometry/geometry.h"

namespace palpate::view {

class ValueScale {
 public:
  ValueScale() = default;
  // Of values between the two, in data units.
  ValueScale(double min, double max);

  double Scaled(double value) const;
  float Scaled(float value) const { return static_cast<float>(Scaled(static_cast<double>(value))); }
  // For a value that is compared with others: the greatest float that is not above it,
  // scaled, and the rest as a float that is not above it. A float is above the value just
  // where it is above the first; the difference to both is as exact as that of doubles.
  Eigen::Vector2d Split(double value) const;

 private:
  double factor_ = 1.0;
};

}  // namespace palpate::view
