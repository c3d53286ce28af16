// What a haptic update with a tool remembers for the next one. server/servo/servo_memory.h lists
// it member by member.
//
// Threads: plain values.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "common/contract/enumerations.h"
#include "server/haptics/passivity.h"
#include "server/haptics/tool/least_move.h"
#include "server/haptics/tool/tool_step.h"

namespace palpate {

inline constexpr double kTankCreditMj = 0.1;

// Between two ticks, no hand gets faster by more than half.
inline constexpr double kFasterInATick = 1.5;

// Keeps a tool's spring passive at the device's port.
//
// The spring takes up work when the stylus moves and when it turns. A device without torque takes
// none for a turn, but would give the spring's energy back by its force: turning the stylus to and
// fro would throw the hand. A device whose torque is at its limit takes too little. So a tank
// counts only what the hand has given by moving and turning against what was written to the device,
// and force and torque are those of the same spring, pressed only so far that it holds what the
// tank holds, and kTankCreditMj. Within the device's limits, and in presses without turns, that is
// the whole spring. A hand that has turned the stylus into a wall, and used the credit up, feels a
// spring that begins where the hand begins to press.
//
// Bound: the hand gets at most kTankCreditMj, plus `budget_mj`, plus the work of ways out in which
// it gets faster than kFasterInATick says. Work is counted with the mean of two forces. That a
// force is held for a tick is passivity.h's matter.
//
// Frame: D, about the HIP. Threads: pure. Real-time: no allocation, O(1).
// Source: F. Barbagli, K. Salisbury, Haptics Symposium 2003, for the energy of fewer motors than
// sensors; the tank is ours.
struct SpringTank {
  double tank_mj = 0.0;           // without the end of the last tick
  Vec6 written_D = Vec6::Zero();  // the last force (N) and torque (N mm) on the hand
  Vec6 moved_D = Vec6::Zero();    // the hand, in the last tick (mm, rad)
  double spring_mj = 0.0;         // then

  // The share of this force and torque (N, N mm) that may act after the hand has moved (mm, rad).
  // `now_mj`: the energy of a spring that has them. `held_mj`: of the tool's spring: without torque
  // it holds more, as the tool turns under a press beside the grip.
  double ShareOf(const Vec6& wrench_D, double now_mj, double held_mj, const Vec6& now_moved_D,
                 double budget_mj) noexcept {
    // Only now it is known what was written at the end of the last tick. What is dissipated is not
    // given back.
    tank_mj = std::min(tank_mj - 0.5 * written_D.dot(moved_D), spring_mj);
    // No debt: a press that begins with one would begin too late.
    const double had_mj =
        std::max(0.0, tank_mj + kTankCreditMj + budget_mj - 0.5 * written_D.dot(now_moved_D));
    tank_mj = had_mj - kTankCreditMj;
    moved_D = now_moved_D;
    spring_mj = held_mj;
    const double given_mj = 0.5 * wrench_D.dot(now_moved_D);
    // A spring that ends within the next tick gives half of that tick's work, whatever it holds.
    const double end_mj = (1.0 + kFasterInATick) * given_mj;
    const double most = end_mj > had_mj ? had_mj / end_mj : 1.0;
    // At share s, the hand gets s given, and the spring holds s² now.
    const double root = std::sqrt(given_mj * given_mj + 4.0 * now_mj * had_mj);
    return root - given_mj < 2.0 * now_mj * most ? (root - given_mj) / (2.0 * now_mj) : most;
  }
};

// The surfaces of a step, and the spring, as far as they tell whether they are the next one's.
struct ToolSurfacesFelt {
  std::uint64_t geometry_revision = 0;
  std::uint64_t volume_revision = 0;
  int refinement = 1;
  FreeSide free_side = FreeSide::kBelow;
  double isovalue = 0.0;
  double stiffness_n_per_mm = 0.0;

  bool operator==(const ToolSurfacesFelt&) const = default;
};

struct ToolMemory {
  ToolState state;
  ToolSurfacesFelt felt;
  bool is_settling = false;  // to what has changed under it
  bool touches = false;
  double slope_per_mm = 0.0;  // the least of the density where the tool touches
  UnalignedQuaternion R_DS = UnalignedQuaternion::Identity();  // of the last stylus
  // The sum of ρ times the stylus's turns since the tool is there, each with the ρ of its tool.
  Vec3 turned_mm = Vec3::Zero();
  double spring_mj = 0.0;  // of force and torque, in the last step
  SpringTank tank;
  PassivityStateOf<6> passivity;  // of a device with torque
};

}  // namespace palpate
