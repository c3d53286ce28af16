#include "server/safety/safety.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Values for hardware. The time in which the Omni's motors warm up is not public. With 10 s, a push
// of 3.3 N from cold is limited after 0.4 s, which errs on the cool side.
constexpr double kRampInS = 0.5;
constexpr double kThermalTimeS = 10.0;
// Twice the speed of a hand within a desk's workspace.
constexpr double kMaxSpeedMmPerS = 2000.0;
constexpr double kSpeedTimeS = 4e-3;
// Six turns a second: no hand turns a stylus so fast. Reasoned, not measured.
constexpr double kMaxTurnRadPerS = 40.0;
// The first limit of any device's torque: higher ones follow once its torque was seen on hardware.
constexpr double kMostTorqueNMm = 50.0;
constexpr double kUnitTolerance = 1e-3;
// One tick of twenty may be missed. Forces ramp out at 20 more missed ticks, in a row or nearly so.
// They return when the count of these falls below kFewMissedTicks.
constexpr double kMaxMissedTicks = 20.0;
constexpr double kMissedPerTick = 0.05;
constexpr double kFewMissedTicks = 1.0;

// Shortens `v` to `length` if it is longer. Scales first, because the norm of a huge vector would
// overflow.
Vec3 Clamp(const Vec3& v, double length) {
  const double scale = v.cwiseAbs().maxCoeff();
  if (!(scale > 0.0)) return Vec3::Zero();
  const Vec3 unit = v / scale;
  const double norm = unit.norm();
  return norm * scale > length ? Vec3(unit * (length / norm)) : v;
}

// At the heat of the continuous value, the limit is the continuous value, so the heat cannot rise
// above it. Half of that heat is free, so that short strokes get all of the force.
double WarmLimit(double full, double continuous, double heat) {
  if (!(continuous > 0.0) || continuous >= full) return full;
  return full -
         (full - continuous) * std::clamp(2.0 * heat / (continuous * continuous) - 1.0, 0.0, 1.0);
}

}  // namespace

SafetyLimits LimitsFor(const DeviceDescription& spec, std::uint32_t stop_buttons) {
  SafetyLimits limits{.max_force_n = spec.max_force_n,
                      .max_torque_n_mm = std::min(spec.max_torque_n_mm, kMostTorqueNMm),
                      .stop_buttons = stop_buttons};
  if (!IsHardware(spec)) return limits;
  limits.ramp_in_s = kRampInS;
  limits.continuous_force_n = spec.continuous_force_n;
  limits.continuous_torque_n_mm = spec.continuous_torque_n_mm;
  limits.thermal_time_s = kThermalTimeS;
  limits.max_speed_mm_per_s = kMaxSpeedMmPerS;
  limits.max_turn_rad_per_s = kMaxTurnRadPerS;
  limits.max_missed_ticks = kMaxMissedTicks;
  limits.faults_stay = true;
  limits.starts_on = false;
  return limits;
}

int RampOutTicks(const SafetyLimits& limits, double dt_s) {
  // 1e-6 more, so that a whole ratio rounds up: rounding errors may leave a tiny last step.
  const double ramp_s = std::max(limits.max_force_n / limits.max_slew_n_per_s,
                                 limits.max_torque_n_mm / limits.max_torque_slew_n_mm_per_s);
  return static_cast<int>(std::ceil(ramp_s / dt_s + 1e-6));
}

Safety::Safety(const SafetyLimits& limits) : limits_(limits) {
  if (limits.starts_on) Enter(ForceState::kRampIn, ForceReason::kNone);
}

Wrench Safety::Step(const SafetyInput& input, double dt_s) noexcept {
  const double elapsed_s = dt_s * (1.0 + static_cast<double>(input.missed_ticks));
  Follow(input, elapsed_s);
  const ForceReason fault = FaultOf(input);
  Obey(input);
  Change(fault, HoldOf(input));
  FollowSuspension(input.suspended || input.pushed);
  faulty_ = fault != ForceReason::kNone || memory_.state == ForceState::kFault;

  const bool cut = faulty_ || memory_.state == ForceState::kStopped || input.suspended ||
                   input.docked || !input.calibrated;
  if (cut) {
    memory_.last_D = {};
  } else {
    StepTo(input.wrench_D, dt_s);
  }
  if (limits_.thermal_time_s > 0.0) {
    const double share = 1.0 - std::exp(-elapsed_s / limits_.thermal_time_s);
    memory_.heat_n2 += (memory_.last_D.force_n.squaredNorm() - memory_.heat_n2) * share;
    memory_.heat_n_mm2 += (memory_.last_D.torque_n_mm.squaredNorm() - memory_.heat_n_mm2) * share;
  }
  return memory_.last_D;
}

double Safety::limit_n() const noexcept {
  return WarmLimit(limits_.max_force_n, limits_.continuous_force_n, memory_.heat_n2);
}

double Safety::torque_limit_n_mm() const noexcept {
  return WarmLimit(limits_.max_torque_n_mm, limits_.continuous_torque_n_mm, memory_.heat_n_mm2);
}

// Updates the speed and the count of missed ticks.
void Safety::Follow(const SafetyInput& input, double elapsed_s) noexcept {
  memory_.missed_ticks =
      std::clamp(memory_.missed_ticks + static_cast<double>(input.missed_ticks) - kMissedPerTick,
                 0.0, 2.0 * kMaxMissedTicks);
  memory_.hip_age_s += elapsed_s;
  if (input.device == DeviceStatus::kFault) memory_.has_hip = false;
  if (input.device != DeviceStatus::kOk || input.position_rejected) return;
  // An absurd reading can make the velocity infinite. Its tick was a fault.
  if (!memory_.velocity_mm_per_s.allFinite()) memory_.velocity_mm_per_s.setZero();
  // A position from before the calibration has no meaning.
  const bool known = memory_.has_hip && input.calibrated;
  const Vec3 velocity_mm_per_s =
      known ? Vec3((input.p_DHip_mm - memory_.p_DHip_mm) / memory_.hip_age_s) : Vec3::Zero();
  const double share = memory_.hip_age_s / (memory_.hip_age_s + kSpeedTimeS);
  memory_.velocity_mm_per_s += share * (velocity_mm_per_s - memory_.velocity_mm_per_s);
  if (!known) memory_.velocity_mm_per_s.setZero();
  if (turns()) {
    const double turn_rad = known ? input.R_DS.angularDistance(memory_.R_DS) : 0.0;
    memory_.turn_rad_per_s += share * (turn_rad / memory_.hip_age_s - memory_.turn_rad_per_s);
    if (!known || !std::isfinite(memory_.turn_rad_per_s)) memory_.turn_rad_per_s = 0.0;
    memory_.R_DS = input.R_DS;
  }
  memory_.p_DHip_mm = input.p_DHip_mm;
  memory_.has_hip = input.calibrated;
  memory_.hip_age_s = 0.0;
}

ForceReason Safety::FaultOf(const SafetyInput& input) const noexcept {
  if (input.device == DeviceStatus::kFault) return ForceReason::kDevice;
  if (input.position_rejected) return ForceReason::kPosition;
  const bool turned = turns();
  if (turned && !(std::abs(input.R_DS.coeffs().norm() - 1.0) <= kUnitTolerance)) {
    return ForceReason::kPosition;
  }
  if (!input.wrench_D.force_n.allFinite() || (turned && !input.wrench_D.torque_n_mm.allFinite())) {
    return ForceReason::kForce;
  }
  // The comparison is negated so that NaN counts as too fast. A fast hand is no fault while there
  // are no forces.
  const double limit = limits_.max_speed_mm_per_s;
  const bool has_forces =
      memory_.state != ForceState::kOff && memory_.state != ForceState::kStopped;
  if (has_forces && limit > 0.0 && !(memory_.velocity_mm_per_s.norm() <= limit))
    return ForceReason::kSpeed;
  const double turn_limit = limits_.max_turn_rad_per_s;
  if (has_forces && turned && turn_limit > 0.0 && !(memory_.turn_rad_per_s <= turn_limit))
    return ForceReason::kSpeed;
  return ForceReason::kNone;
}

ForceReason Safety::HoldOf(const SafetyInput& input) const noexcept {
  if (input.docked) return ForceReason::kDocked;
  if (!input.calibrated) return ForceReason::kUncalibrated;
  if (input.device == DeviceStatus::kStale) return ForceReason::kStale;
  const bool is_held = memory_.reason == ForceReason::kDeadlines;
  const double most = is_held ? kFewMissedTicks : limits_.max_missed_ticks;
  if (limits_.max_missed_ticks > 0.0 && memory_.missed_ticks > most) return ForceReason::kDeadlines;
  return ForceReason::kNone;
}

void Safety::Obey(const SafetyInput& input) noexcept {
  if (input.command == ForceCommand::kDisable) Enter(ForceState::kOff, ForceReason::kOperator);
  if (input.command == ForceCommand::kEnable &&
      (memory_.state == ForceState::kOff || memory_.state == ForceState::kFault ||
       memory_.state == ForceState::kStopped)) {
    Enter(ForceState::kRampIn, ForceReason::kNone);
  }
  if (input.command == ForceCommand::kStop) Enter(ForceState::kStopped, ForceReason::kStopCall);
  const bool buttons =
      limits_.stop_buttons != 0 && (input.buttons & limits_.stop_buttons) == limits_.stop_buttons;
  if (buttons) Enter(ForceState::kStopped, ForceReason::kStopButton);
}

void Safety::Enter(ForceState state, ForceReason reason) noexcept {
  if (state == ForceState::kRampIn) {
    memory_.ramp_s = 0.0;
    memory_.ramp_in_s = limits_.ramp_in_s;
  }
  memory_.state = state;
  memory_.reason = reason;
}

// Changes the state by the condition of the device and the hand.
void Safety::Change(ForceReason fault, ForceReason hold) noexcept {
  if (memory_.state == ForceState::kOff || memory_.state == ForceState::kStopped) return;
  if (fault != ForceReason::kNone) return Enter(ForceState::kFault, fault);
  if (memory_.state == ForceState::kFault) {
    if (limits_.faults_stay) return;
    Enter(ForceState::kRampIn, ForceReason::kNone);
  }
  if (hold != ForceReason::kNone) return Enter(ForceState::kHeld, hold);
  if (memory_.state == ForceState::kHeld) Enter(ForceState::kRampIn, ForceReason::kNone);
  if (memory_.state == ForceState::kRampIn && memory_.ramp_s >= memory_.ramp_in_s) {
    Enter(ForceState::kOn, ForceReason::kNone);
  }
}

// The stylus may rest deep inside when a suspension ends.
void Safety::FollowSuspension(bool suspended) noexcept {
  if (suspended) {
    memory_.resumes = memory_.resumes || memory_.was_suspended;
  } else if (memory_.resumes &&
             (memory_.state == ForceState::kOn || memory_.state == ForceState::kRampIn)) {
    Enter(ForceState::kRampIn, ForceReason::kNone);
    memory_.ramp_in_s = kRampInS;
    memory_.resumes = false;
  }
  memory_.was_suspended = suspended;
}

// Moves the force and the torque towards what is wanted, within all limits.
void Safety::StepTo(const Wrench& wanted_D, double dt_s) noexcept {
  const double share = Share(dt_s);
  Wrench& last_D = memory_.last_D;
  const Vec3 force_n = Clamp(wanted_D.force_n, share * limit_n());
  last_D.force_n += Clamp(force_n - last_D.force_n, limits_.max_slew_n_per_s * dt_s);
  if (!turns()) return;
  const Vec3 torque_n_mm = Clamp(wanted_D.torque_n_mm, share * torque_limit_n_mm());
  last_D.torque_n_mm +=
      Clamp(torque_n_mm - last_D.torque_n_mm, limits_.max_torque_slew_n_mm_per_s * dt_s);
}

// The share of the limits that may act in this tick.
double Safety::Share(double dt_s) noexcept {
  if (memory_.state == ForceState::kOn) return 1.0;
  if (memory_.state != ForceState::kRampIn) return 0.0;
  memory_.ramp_s += dt_s;
  return std::min(memory_.ramp_s / memory_.ramp_in_s, 1.0);
}

}  // namespace palpate
