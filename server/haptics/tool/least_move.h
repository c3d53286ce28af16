// The move nearest to a wanted one among those that some half-spaces allow, in six dimensions.
//
// Threads: pure. Real-time: no allocation; at most kMostLeastMoveSteps changes of the active set.
// Source: D. Goldfarb, A. Idnani, Mathematical Programming 27, 1983, for the unit matrix.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "common/geometry/geometry.h"

namespace palpate {

using Vec6 = Eigen::Matrix<double, 6, 1>;

inline constexpr int kMostLeastMoveSteps = 100;

// along · x >= least.
struct MoveLimit {
  Vec6 along;
  double least;
};

struct LeastMove {
  Vec6 x = Vec6::Zero();
  // The limits that hold x back, by their numbers.
  std::array<int, 6> active{};
  int active_count = 0;
  bool feasible = true;
  int steps = 0;  // in each of them, all limits were looked at
};

// `tolerance`: a limit may be violated by this, for a row of length 1. Of rows that depend on
// others, some are left out.
LeastMove NearestMove(const Vec6& wanted, std::span<const MoveLimit> limits, double tolerance,
                      int most_steps = kMostLeastMoveSteps) noexcept;

}  // namespace palpate
