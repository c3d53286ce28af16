// Keeps the force of a tool passive on a device without torque.
//
// The tool's spring takes up work when the stylus turns, too. A device without torque takes none
// for a turn, but would give the spring's energy back by its force: turning the stylus to and fro
// would throw the hand. So a tank counts only what the hand has given by moving against the force,
// and the force is never that of a spring with more energy than the tank and kPortCreditMj.
// Pressing and sliding without turns is not changed: the tank then holds all of the spring.
//
// Bound: the hand gets at most kPortCreditMj, plus `budget_mj`. Work is counted with the mean of
// two forces; that a force is held for a tick is passivity.h's matter.
//
// Units: N, mm, mJ. Frame: D. Threads: pure. Real-time: no allocation, O(1).
// Source: F. Barbagli, K. Salisbury, Haptics Symposium 2003, for the energy of fewer motors than
// sensors; the tank is ours.
#pragma once

#include <algorithm>

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
    const double before_mj = tank_mj + budget_mj - 0.5 * written_D_n.dot(moved_mm);
    // At share s, the tank is before - s given, and the spring has s spring.
    const double given_mj = 0.5 * force_D_n.dot(moved_mm);
    const double needed_mj = spring_mj + given_mj;
    const double room_mj = std::max(0.0, before_mj + kPortCreditMj);
    const double share = needed_mj > room_mj ? room_mj / needed_mj : 1.0;
    // What is dissipated is not given back.
    tank_mj = std::min(before_mj - share * given_mj, spring_mj);
    return share;
  }
};

}  // namespace palpate
