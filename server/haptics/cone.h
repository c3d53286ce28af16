// Projection of a vector on a polyhedral cone of at most four half-spaces.
//
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include <array>
#include <cstdint>

#include "common/geometry/geometry.h"

namespace palpate {

// {x : normal[i] · x >= 0 for i < count}; normals of any length.
struct Cone {
  std::array<Vec3, 4> normal;
  int count = 0;

  // Adds a half-space and returns its number. A zero normal constrains nothing: it is not added,
  // and Add returns -1.
  int Add(const Vec3& inward) {
    if (inward.isZero(0.0)) return -1;
    normal[count] = inward;
    return count++;
  }
};

struct ConeProjection {
  Vec3 d = Vec3::Zero();
  std::uint8_t active = 0;  // bit i: d lies in the plane of half-space i
};

// Returns the point of the cone that is closest to `w`.
ConeProjection ProjectOnCone(const Vec3& w, const Cone& cone) noexcept;

}  // namespace palpate
