// Passivity control: keeps a rendered spring from giving the hand energy.
//
// A spring rendered once per tick acts late: between ticks the force is held, and
// the device adds a tick. While the stylus presses in, the force lags below that
// of the true spring; while it retreats, above. So each stroke gives the hand a
// little more than it took, as negative damping of about stiffness times delay.
// A hand damped less than that is driven into a buzz.
//
// Observer: a tank holds the energy taken from the hand, less what was given
// back: -f·dx, with the least of the forces that may have acted. Two of them may
// (one tick of hold, one of delay); kForcesCounted are looked at, so that the
// observer sees more delay than there is and the hand is damped, not just held
// at balance. The tank holds at most the energy U that the ideal spring stores
// at this depth: what was dissipated cannot be given back later.
//
// Controller: what the tank lacks to U is the energy that the spring created.
// - A little lacks: the force is damped, in proportion, along its direction. The
//   velocity is the slope of the longest line through the last positions that
//   stays within one count of the sensor (first-order adaptive windowing;
//   F. Janabi-Sharifi, V. Hayward, C.-S. Chen, IEEE Trans. Control Systems
//   Technology 8, 2000): no noise from a count that flickers, little lag in a
//   fast stroke.
// - More than kCreditMj lacks: stiffness sinks until what is left to give is in
//   the tank, and comes back at a limited rate once the tank allows it.
// With a full tank the force passes unaltered.
//
// Bound: energy given minus energy taken stays below kCreditMj plus
// kForgivenMjPerS times the time, up to what the sensor's resolution hides
// (half a count times each change of force). Not covered: forces added after this
// stage, and a slew limit that lets the force fall later than asked for; see
// `written_D_n`.
//
// Units: N, mm, s; 1 N·mm = 1 mJ. Frame: D.
// Threads: pure; one thread per state. Real-time: no allocation, no locks, O(1).
// Source: B. Hannaford, J.-H. Ryu, "Time-domain passivity control of haptic
// interfaces", IEEE Trans. Robotics and Automation 18, 2002: observer and damping.
#pragma once

#include <array>

#include "common/geometry/geometry.h"

namespace palpate {

// Lacking energy at which the stiffness begins to sink.
inline constexpr double kCreditMj = 0.8;
// Lacking energy at which the damping is at its full strength.
inline constexpr double kFullDampingMj = 0.1;
// Energy forgiven, so that one hard blow does not soften the wall for ever.
inline constexpr double kForgivenMjPerS = 0.03;

struct PassivityState {
  static constexpr int kForcesCounted = 4;
  static constexpr int kPositionsKept = 10;

  bool started = false;
  double tank_mj = 0.0;  // below 0: a debt
  double scale = 1.0;    // rendered stiffness over the one asked for
  double damping = 0.0;  // in [0, 1], of the full one; for display
  double distrust = 0.0;
  // Forces on the hand, newest first. A caller that limits the force further
  // stores what it wrote in the first column.
  Eigen::Matrix<double, 3, kForcesCounted> written_D_n =
      Eigen::Matrix<double, 3, kForcesCounted>::Zero();
  // The last positions of the HIP and their times, a ring.
  std::array<Vec3, kPositionsKept> p_DHip_mm;
  std::array<double, kPositionsKept> time_s{};
  int positions = 0;
  int newest = 0;
};

// What is left of the contact force.
// force_D_n: spring, damper and friction, within the device's limit. Effects that
//   bring energy in by design (magnets) are to be added to the result.
// depth_mm: |SCP_H - HIP| in contact, 0 without.
// budget_mj: by how much the energy stored in the spring grew in this tick without
//   the hand's doing: the surface was moved (τ, edits, a pop).
// dt_s: since the last call; longer where ticks were missed.
// An input that is not finite, or a time not above 0, gives no force and starts
// the account anew.
Vec3 LimitToPassive(const Vec3& force_D_n, double stiffness_n_per_mm, double depth_mm,
                    const Vec3& p_DHip_mm, double budget_mj, double dt_s,
                    PassivityState& state) noexcept;

}  // namespace palpate
