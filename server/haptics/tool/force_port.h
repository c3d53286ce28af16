// Keeps the force of a tool passive on a device without torque.
//
// The tool's spring takes up work when the stylus turns, too. A device without torque takes none
// for a turn, but would give the spring's energy back by its force: turning the stylus to and fro
// would throw the hand. So a tank counts only what the hand has given by moving against the force,
// and the force is that of the same spring, pressed only so far that it holds what the tank holds,
// and kPortCreditMj. Pressing and sliding without turns is not changed: the tank then holds all of
// the spring. A hand that has turned the stylus into a wall, and used the credit up, feels a spring
// that begins where the hand begins to press.
//
// Bound: the hand gets at most kPortCreditMj, plus `budget_mj`, plus what a sampled spring gives
// where it ends between two ticks: an eighth of stiffness times (way in a tick)². Work is counted
// with the mean of two forces; that a force is held for a tick is passivity.h's matter.
//
// Units: N, mm, mJ. Frame: D. Threads: pure. Real-time: no allocation, O(1).
// Source: F. Barbagli, K. Salisbury, Haptics Symposium 2003, for the energy of fewer motors than
// sensors; the tank is ours.
#pragma once

#include <algorithm>
#include <cmath>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr double kPortCreditMj = 0.1;

struct ForcePort {
  double tank_mj = 0.0;
  Vec3 written_D_n = Vec3::Zero();  // the last force on the hand

  // The share of the force that may act after the hand has moved by `moved_mm`. `spring_mj`: the
  // energy of a spring without turns that has this force.
  double ShareOf(const Vec3& force_D_n, double spring_mj, const Vec3& moved_mm,
                 double budget_mj) noexcept {
    // No spring gives more than it holds: the rest is the tick's, and no debt.
    const double had_mj =
        std::max(0.0, tank_mj + kPortCreditMj + budget_mj - 0.5 * written_D_n.dot(moved_mm));
    // At share s, the hand gets s given, and the spring holds s² spring.
    const double given_mj = 0.5 * force_D_n.dot(moved_mm);
    const double root = std::sqrt(given_mj * given_mj + 4.0 * spring_mj * had_mj);
    const double share =
        root - given_mj < 2.0 * spring_mj ? (root - given_mj) / (2.0 * spring_mj) : 1.0;
    // What is dissipated is not given back.
    tank_mj = std::min(had_mj - kPortCreditMj - share * given_mj, spring_mj);
    return share;
  }
};

}  // namespace palpate
