// Passivity control: keeps a rendered spring from giving the hand energy.
//
// A spring rendered once per tick acts late: the force is held for a tick, and the
// device may add one. While the stylus presses in, the force lags below that of
// the true spring; while it retreats, above. Each stroke so gives the hand a
// little more than it took, as a negative damping of about stiffness times delay.
// A hand damped less than that is driven into a buzz.
//
// Observer: a tank holds the energy taken from the hand less that given back,
// -f·dx, with the least of the forces that may have acted. Two may (hold, delay);
// kForcesCounted are looked at, so that a vibration is damped and not just kept
// from growing. The tank holds at most what the ideal spring stores at this depth:
// energy once dissipated is not given back. What it lacks to that, the rendering
// has created.
//
// Controller, by what the tank lacks:
// - nothing: the force passes unaltered;
// - up to kFullDampingMj: the stylus is damped, in proportion: along the force, so
//   that it does not vibrate, and across, because a late force pushes a stylus that
//   slides over a convex surface on its way;
// - up to kSoftMj: the stiffness sinks besides, to kSafeNPerMm, where that damping
//   steadies a hand of 30 g or more with next to none of its own. It comes back
//   once the stylus leaves the surface;
// - kCreditMj: nothing more is given than is in the tank, however soft that is.
// The damper's velocity is the slope of the longest line through the last
// positions that keeps within a count of the sensor: a count that flickers is no
// motion, and a fast stroke is followed with little lag.
//
// What the tank lacks is forgiven at kForgivenMjPerS; in contact only down to
// kFullDampingMj, so that a hand that was damped stays so. It is forgiven at once
// while the stylus rests within a count on a spring of at most kSafeNPerMm: a
// flickering sensor looks like a vibration and must not make the wall creep.
//
// Bound: net energy given to the hand stays below kCreditMj plus what was forgiven,
// up to what the sensor hides (half a count times each change of force).
// Not covered: forces added after this stage; and a stage after it that lets the
// force fall later than asked for (a slew limit), see `written_D_n`.
//
// The device is the caller's to say: its count, its greatest force, its tick. The constants
// below are about hands.
//
// Units: N, mm, s; 1 N·mm = 1 mJ. Frame: D.
// Threads: pure; one thread per state. Real-time: no allocation, no locks, O(1).
// Source: time-domain passivity, B. Hannaford and J.-H. Ryu, IEEE Trans. Robotics
// and Automation 18, 2002; the window of velocities, F. Janabi-Sharifi et al., IEEE
// Trans. Control Systems Technology 8, 2000.
#pragma once

#include <array>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr double kFullDampingMj = 0.1;
inline constexpr double kSoftMj = 0.2;
inline constexpr double kCreditMj = 0.8;
inline constexpr double kForgivenMjPerS = 0.03;
inline constexpr double kSafeNPerMm = 0.5;

struct PassivityState {
  static constexpr int kForcesCounted = 4;
  static constexpr int kPositionsKept = 10;
  using Forces = Eigen::Matrix<double, 3, kForcesCounted>;

  bool started = false;
  double tank_mj = 0.0;   // below 0: a debt
  double damping = 0.0;   // share of the full one
  double distrust = 0.0;  // 1: the stiffness has sunk to kSafeNPerMm
  double scale = 1.0;     // of the stiffness
  // The last forces on the hand, newest first. A caller that limits the force
  // further stores what it wrote in the first column.
  Forces written_D_n = Forces::Zero();
  // The last positions of the HIP and their times: a ring.
  std::array<Vec3, kPositionsKept> p_DHip_mm = [] {
    std::array<Vec3, kPositionsKept> none;
    none.fill(Vec3::Zero());
    return none;
  }();
  std::array<double, kPositionsKept> time_s{};
  int positions = 0;
  int newest = 0;
  // Where the stylus rests within a count, and since when.
  Vec3 rest_mm = Vec3::Zero();
  double rested_s = 0.0;
};

// What the control has to know of a device. Unless told otherwise, a Phantom Omni.
struct PassivityDevice {
  double resolution_mm = 0.055;  // of the position, above 0
  double max_force_n = 3.3;      // on the hand, above 0
  double tick_s = 1e-3;          // between two forces, above 0

  bool operator==(const PassivityDevice&) const = default;
};

// All three are finite and above 0.
bool IsDevice(const PassivityDevice& device);

// What is left of the contact force.
// force_D_n: spring, damper and friction. Magnets and the like bring energy in by
//   design: add them to the result.
// depth_mm: |SCP_H - HIP| in contact, 0 without.
// budget_mj: by how much the energy stored in the spring grew in this tick without
//   the hand's doing, because the surface was moved (τ, edits, a pop).
// dt_s: since the last call; longer where ticks were missed.
// Input that is not finite, or a time not above 0, gives no force and starts the
// account anew. The result is finite and at most device.max_force_n.
Vec3 LimitToPassive(const Vec3& force_D_n, double stiffness_n_per_mm, double depth_mm,
                    const Vec3& p_DHip_mm, double budget_mj, double dt_s,
                    const PassivityDevice& device, PassivityState& state) noexcept;

}  // namespace palpate
