// Directions that are spread evenly over the sphere.
//
// Threads: pure.
#pragma once

#include <cmath>

#include "common/geometry/geometry.h"

namespace palpate {

// Calls visit(direction) with `count` directions (unit) along a spiral. They have the same bits on
// every machine, unlike sines.
template <class Visit>
void VisitDirections(int count, Visit visit) {
  // Of the golden angle, by which each direction is turned from the one before.
  constexpr double kCosine = -0.7373688780783197, kSine = 0.6754902942615238;
  double x = 1.0, y = 0.0;
  for (int n = 0; n < count; ++n) {
    const double z = 1.0 - (2.0 * n + 1.0) / count, across = std::sqrt(1.0 - z * z);
    visit(Vec3(across * x, across * y, z));
    const double turned = kCosine * x - kSine * y;
    y = kSine * x + kCosine * y;
    x = turned;
  }
}

}  // namespace palpate
