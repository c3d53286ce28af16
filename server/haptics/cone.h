// Projection of a vector on a polyhedral cone of at most four half-spaces.
//
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include <array>
#include <cstdint>

#include "common/geometry/geometry.h"

namespace palpate {

// {x : normal · x >= 0}, with a normal of any length.
struct HalfSpace {
  Vec3 normal;     // inward
  double normal2;  // its squared length

  HalfSpace() = default;
  explicit HalfSpace(const Vec3& inward) : normal(inward), normal2(inward.squaredNorm()) {}
};

// The intersection of half-spaces.
struct Cone {
  std::array<HalfSpace, 4> side;
  int count = 0;

  // Adds a half-space and returns its number. A zero normal constrains nothing: it is not added,
  // and Add returns -1.
  int Add(const HalfSpace& inward) {
    if (inward.normal.isZero(0.0)) return -1;
    side[count] = inward;
    return count++;
  }
};

struct ConeProjection {
  Vec3 d = Vec3::Zero();
  std::uint8_t active = 0;  // bit i: d lies in the plane of half-space i
};

// Returns the point of the cone that is closest to `w`, if its squared length is greater than
// `longer_than2`; otherwise zero, which costs less.
ConeProjection ProjectOnCone(const Vec3& w, const Cone& cone, double longer_than2 = 0.0) noexcept;

}  // namespace palpate
