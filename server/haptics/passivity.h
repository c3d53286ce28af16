// Passivity control: keeps a rendered spring from giving the hand energy.
//
// A spring that is rendered once per tick acts late: the force is held for a tick, and the device
// may add another tick. While the stylus presses in, the force is below that of the true spring;
// while the stylus retreats, above it. So each stroke gives the hand a little more energy than it
// took. This acts as a negative damping of about stiffness times delay. If the hand's own damping
// is smaller, the stylus buzzes.
//
// Observer: a tank holds the energy taken from the hand minus the energy given back, -f·dx. It uses
// the least of the forces that may have acted. Two forces may have acted (hold, delay). The
// observer considers kForcesCounted forces, so that a vibration is damped and not only kept from
// growing. The tank holds at most the energy that the ideal spring stores at this depth: dissipated
// energy is not given back. The energy that the tank lacks was created by the rendering.
//
// Controller, by the energy that the tank lacks:
// - nothing: the force is not changed;
// - up to kFullDampingMj: the stylus is damped in proportion. Damping along the force prevents
//   vibration. Damping across the force is needed because a late force pushes a stylus forward that
//   slides over a convex surface;
// - up to kSoftMj: in addition the stiffness falls to kSafeNPerMm. At that stiffness the damping
//   steadies a hand of 30 g or more that has next to no damping of its own. The stiffness returns
//   once the stylus leaves the surface;
// - kCreditMj: no more energy is given than the tank holds, however soft the surface becomes.
// The damper's velocity is the slope of the longest line through the last positions that stays
// within a count of the sensor. A flickering count is therefore no motion, and a fast stroke is
// followed with little lag.
//
// Missing energy is forgiven at kForgivenMjPerS; in contact only down to kFullDampingMj, so that
// the damping of a hand continues. It is forgiven faster while the stylus rests within a count on a
// spring of at most kSafeNPerMm: a flickering sensor looks like a vibration and must not make the
// wall creep.
//
// Bound: the net energy given to the hand stays below kCreditMj plus the forgiven energy, except
// for the energy that the sensor hides (half a count times each change of force).
// Not covered: forces added after this stage, and a later stage that lets the force fall later than
// requested (a slew limit), see `written_D_n`.
//
// The caller gives the device's values: its count, its greatest force, its tick. The constants
// below depend on hands.
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

// kDimensions: 3 for a force alone. 6 for force and torque: positions are then (x, ρ turn) in mm,
// forces (force, torque / ρ) in N, with a length ρ, so that their product is the work.
template <int kDimensions>
struct PassivityStateOf {
  static constexpr int kForcesCounted = 4;
  static constexpr int kPositionsKept = 10;
  using Vector = Eigen::Matrix<double, kDimensions, 1>;
  using Forces = Eigen::Matrix<double, kDimensions, kForcesCounted>;

  bool started = false;
  double tank_mj = 0.0;   // negative: a debt
  double damping = 0.0;   // share of the full damping
  double distrust = 0.0;  // 1: the stiffness has sunk to kSafeNPerMm
  double scale = 1.0;     // factor of the stiffness
  // The last forces on the hand, newest first. A caller that limits the force further stores the
  // written force in the first column.
  Forces written_D_n = Forces::Zero();
  // The last positions of the HIP and their times: a ring.
  std::array<Vector, kPositionsKept> p_DHip_mm = [] {
    std::array<Vector, kPositionsKept> none;
    none.fill(Vector::Zero());
    return none;
  }();
  std::array<double, kPositionsKept> time_s{};
  int positions = 0;
  int newest = 0;
  // The place where the stylus rests within a count, and for how long.
  Vector rest_mm = Vector::Zero();
  double rested_s = 0.0;
};
using PassivityState = PassivityStateOf<3>;

// Values of a device that the control needs. Defaults: a Phantom Omni.
struct PassivityDevice {
  double resolution_mm = 0.055;  // of the position, above 0
  double max_force_n = 3.3;      // on the hand, above 0
  double tick_s = 1e-3;          // between two forces, above 0
  double max_torque_n_mm = 0.0;  // on the hand; 0: the device has no torque

  bool operator==(const PassivityDevice&) const = default;
};

// True if the values are finite, and as above.
bool IsDevice(const PassivityDevice& device);

// Returns the contact force after the control.
// force_D_n: spring, damper and friction. Magnets and similar effects add energy by design: add
// their forces to the result.
// depth_mm: |SCP_H - HIP| in contact, 0 without contact.
// held_mm: the depth of a spring with the energy that the hand may have given, where that is more:
// a force alone does not show what turns hold.
// budget_mj: the energy that the spring gained in this tick because the surface was moved (τ,
// edits, a pop) and not by the hand.
// dt_s: time since the last call; longer if ticks were missed.
// If an input is not finite, or dt_s is not above 0, the force is zero and the account starts anew.
// The result is finite and at most device.max_force_n.
template <int kDimensions>
typename PassivityStateOf<kDimensions>::Vector LimitToPassive(
    const typename PassivityStateOf<kDimensions>::Vector& force_D_n, double stiffness_n_per_mm,
    double depth_mm, const typename PassivityStateOf<kDimensions>::Vector& p_DHip_mm,
    double budget_mj, double dt_s, const PassivityDevice& device,
    PassivityStateOf<kDimensions>& state, double held_mm = 0.0) noexcept;

}  // namespace palpate
