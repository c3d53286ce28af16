#include "server/simulated_hand/simulated_device.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr double kSubstepS = 1e-4;

// The wrist: a damped spring, a little more than critically damped, as the hand.
constexpr double kWristKgMm2 = 90.0;  // 0.1 kg at 30 mm
constexpr double kWristSpringNMmPerRad = 500.0;
constexpr double kWristDamperNMmSPerRad = 20.0;
constexpr double kKgMm2PerNMmS2 = 1e3;

// Without torque. What the hand wants leaps where somebody else begins to turn the stylus.
constexpr double kMostTurnRadPerS = 8.0;

constexpr double kRestTiltRad = 0.6;  // barrel up from the user's direction
constexpr double kTiltRadPerMmS = 0.003;
constexpr double kLargestTiltRad = 0.35;
constexpr double kTiltFilterS = 0.2;
constexpr double kSwayRad = 0.08;
constexpr double kSwayHz = 0.15;

// Limits a force or a torque to its peak, as motors do. Computes a norm that does not
// overflow.
Vec3 Saturated(const Vec3& v, double peak) {
  if (!v.allFinite()) return Vec3::Zero();
  const double size = v.stableNorm();
  return size > peak ? Vec3(v * (peak / size)) : v;
}

}  // namespace

DeviceDescription SimulatedDeviceSpec(double max_torque_n_mm) {
  DeviceDescription spec;
  spec.kind = "simulated";
  spec.model = "Simulated Phantom Omni";
  spec.workspace_min_mm = Vec3(-80.0, -60.0, -35.0);
  spec.workspace_max_mm = Vec3(80.0, 60.0, 35.0);
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.max_torque_n_mm = max_torque_n_mm;
  spec.senses_orientation = true;
  spec.position_resolution_mm = 0.055;
  spec.button_count = 2;
  spec.verification_level = VerificationLevel::kSimulated;
  return spec;
}

SimulatedDevice::SimulatedDevice(std::unique_ptr<StylusScript> script,
                                 const DeviceDescription& spec)
    : spec_(spec), script_(std::move(script)) {
  if (script_ == nullptr) {
    throw Error(ErrorKind::kInvalidArgument, "a simulated device needs a script for its hand");
  }
  hand_.p_MHip_mm = script_->Next(hand_, Wrench(), 0.0).p_MTarget_mm;
  StopAtWorkspace();
  R_MS_ = TiltedStylus(0.0);
}

DeviceStatus SimulatedDevice::Read(DeviceState& state) noexcept {
  if (!started_) return DeviceStatus::kFault;
  // Counts from the lower stops, as an encoder does, so that no reading lies beyond a stop.
  const Vec3 counts = (hand_.p_MHip_mm - spec_.workspace_min_mm) / spec_.position_resolution_mm;
  state.p_MHip_mm =
      spec_.workspace_min_mm + Vec3(counts.array().floor()) * spec_.position_resolution_mm;
  state.R_MS = R_MS_;
  state.buttons = buttons_;
  state.p_MLed_mm = p_MLed_mm_;
  return DeviceStatus::kOk;
}

void SimulatedDevice::Write(const DeviceCommand& command, double dt_s) noexcept {
  if (!started_ || !(dt_s > 0.0)) return;
  const double move_s = std::min(dt_s, kLongestMoveS);
  const Wrench felt_M = {Saturated(command.wrench_M.force_n, spec_.max_force_n),
                         Saturated(command.wrench_M.torque_n_mm, spec_.max_torque_n_mm)};
  hand_.R_MS = UnalignedQuaternion(R_MS_);
  const StylusScript::Target target = script_->Next(hand_, felt_M, move_s);
  buttons_ = target.buttons;
  p_MLed_mm_ = target.p_MLed_mm;
  MoveHand(target.p_MTarget_mm, felt_M.force_n, move_s);
  const Eigen::Quaterniond by_itself = TiltedStylus(move_s);
  TurnStylus(target.is_turned ? Eigen::Quaterniond(target.R_MTarget) : by_itself,
             felt_M.torque_n_mm, move_s);
}

// As MoveHand.
void SimulatedDevice::TurnStylus(const Eigen::Quaterniond& R_MTarget, const Vec3& torque_M_n_mm,
                                 double dt_s) {
  if (!(spec_.max_torque_n_mm > 0.0)) {
    const double angle_rad = R_MS_.angularDistance(R_MTarget);
    const double most_rad = kMostTurnRadPerS * dt_s;
    R_MS_ = angle_rad > most_rad ? R_MS_.slerp(most_rad / angle_rad, R_MTarget) : R_MTarget;
    R_MS_.normalize();
    return;
  }
  const int substeps = static_cast<int>(std::ceil(dt_s / kSubstepS));
  const double substep_s = dt_s / substeps;
  for (int i = 0; i < substeps; ++i) {
    const Eigen::AngleAxisd away(R_MTarget * R_MS_.conjugate());
    const Vec3 total_n_mm = torque_M_n_mm + kWristSpringNMmPerRad * away.angle() * away.axis() -
                            kWristDamperNMmSPerRad * turn_rad_s_;
    turn_rad_s_ += total_n_mm * (kKgMm2PerNMmS2 / kWristKgMm2 * substep_s);
    const Vec3 turn_rad = turn_rad_s_ * substep_s;
    const double angle_rad = turn_rad.norm();
    if (angle_rad > 0.0) {
      R_MS_ = Eigen::AngleAxisd(angle_rad, turn_rad / angle_rad) * R_MS_;
      R_MS_.normalize();
    }
  }
}

// Semi-implicit Euler, so that a stiff spring gains no energy.
void SimulatedDevice::MoveHand(const Vec3& p_MTarget_mm, const Vec3& force_M_n, double dt_s) {
  const int substeps = static_cast<int>(std::ceil(dt_s / kSubstepS));
  const double substep_s = dt_s / substeps;
  for (int i = 0; i < substeps; ++i) {
    const Vec3 total_n = force_M_n + kHandSpringNPerMm * (p_MTarget_mm - hand_.p_MHip_mm) -
                         kHandDamperNsPerMm * hand_.v_MHip_mm_s;
    hand_.v_MHip_mm_s += total_n * (kMmPerM / kHandMassKg * substep_s);
    hand_.p_MHip_mm += hand_.v_MHip_mm_s * substep_s;
    StopAtWorkspace();
  }
}

// The device's mechanical stops. They take away all speed towards them.
void SimulatedDevice::StopAtWorkspace() {
  for (int i = 0; i < 3; ++i) {
    double& p_mm = hand_.p_MHip_mm[i];
    double& v_mm_s = hand_.v_MHip_mm_s[i];
    if (p_mm < spec_.workspace_min_mm[i]) {
      p_mm = spec_.workspace_min_mm[i];
      v_mm_s = std::max(v_mm_s, 0.0);
    } else if (p_mm > spec_.workspace_max_mm[i]) {
      p_mm = spec_.workspace_max_mm[i];
      v_mm_s = std::min(v_mm_s, 0.0);
    }
  }
}

// The barrel points up and to the user, trails the tip's motion and sways a little.
Eigen::Quaterniond SimulatedDevice::TiltedStylus(double dt_s) {
  smooth_velocity_mm_s_ +=
      (hand_.v_MHip_mm_s - smooth_velocity_mm_s_) * (dt_s / (kTiltFilterS + dt_s));
  sway_phase_rad_ =
      std::fmod(sway_phase_rad_ + 2.0 * std::numbers::pi * kSwayHz * dt_s, 2.0 * std::numbers::pi);
  const Eigen::Quaterniond rest(Eigen::AngleAxisd(-kRestTiltRad, Vec3::UnitX()));
  const Vec3 barrel = rest * Vec3::UnitZ();
  // Turns the barrel against the velocity.
  Vec3 tilt_rad = smooth_velocity_mm_s_.cross(barrel) * kTiltRadPerMmS;
  tilt_rad += Vec3::UnitZ() * (kSwayRad * std::sin(sway_phase_rad_));
  const double angle_rad = tilt_rad.norm();
  Eigen::Quaterniond tilted = rest;
  if (angle_rad > 0.0) {
    const double limited_rad = std::min(angle_rad, kLargestTiltRad);
    tilted = Eigen::Quaterniond(Eigen::AngleAxisd(limited_rad, tilt_rad / angle_rad)) * rest;
  }
  tilted.normalize();
  return tilted;
}

}  // namespace palpate
