// Numbers that tests of devices share.
#pragma once

#include <cstring>
#include <limits>

#include "common/geometry/geometry.h"

namespace palpate::test {

inline constexpr double kTickS = 1e-3;
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

inline bool SameBits(const Vec3& a, const Vec3& b) {
  return std::memcmp(a.data(), b.data(), sizeof(double) * 3) == 0;
}

}  // namespace palpate::test
