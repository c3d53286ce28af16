#include "server/device/openhaptics/hd_servo.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>

#include "server/device/openhaptics/hd_errors.h"

namespace palpate {
namespace {

constexpr std::int64_t kNsPerMs = 1'000'000;
// A faulty library might return errors without end. It must not hold up the thread.
constexpr int kMostErrorsAFrame = 8;
// The least time between two requests to calibrate, because a request may write to the device.
constexpr int kCalibrationFrames = 100;
// Rounding may leave this much of a rotation's columns. Beyond it the matrix is no rotation.
constexpr double kRotationTolerance = 0.05;

std::int64_t NowNs() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

bool IsRotation(const Eigen::Matrix3d& matrix) noexcept {
  if (!matrix.allFinite() || !(matrix.determinant() > 0.0)) return false;
  const Eigen::Matrix3d left = matrix.transpose() * matrix - Eigen::Matrix3d::Identity();
  return left.cwiseAbs().maxCoeff() < kRotationTolerance;
}

Vec3 Limited(const Vec3& force_n, double max_force_n) noexcept {
  if (!force_n.allFinite()) return Vec3::Zero();
  const double size_n = force_n.stableNorm();
  return size_n > max_force_n ? Vec3(force_n * (max_force_n / size_n)) : force_n;
}

void Count(std::atomic<std::uint64_t>& count) noexcept {
  count.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace

void HdServo::Begin(const HdConnection& connection) noexcept {
  connection_ = connection;
  motors_on_ = false;
  bad_frames_ = 0;
  frames_to_calibration_ = 0;
  stopping_.store(false);
  lost_.store(false);
  has_reading_.store(false);
  zero_frames_.store(0);
  force_error_until_ns_.store(0);
  frame_ns_.store(NowNs());
  streaming_.store(true, std::memory_order_release);
}

hd::CallbackCode HdServo::Frame(void* self) noexcept {
  static_cast<HdServo*>(self)->RunFrame();
  return hd::kCallbackContinue;
}

void HdServo::RunFrame() noexcept {
  const std::int64_t now_ns = NowNs();
  frame_ns_.store(now_ns, std::memory_order_relaxed);
  const bool was_stopping = stopping_.load(std::memory_order_acquire);

  Reading reading;
  reading.at_ns = now_ns;
  Calibrate();
  const std::optional<Vec3> next = NextForce(now_ns);
  SetMotors(next.has_value());
  hd_.begin_frame(connection_.handle);
  const bool is_whole = TakeReading(reading);
  const Vec3 force_D_n = next.value_or(Vec3::Zero());
  const std::array<double, 3> force_n = {force_D_n.x(), force_D_n.y(), force_D_n.z()};
  hd_.set_doublev(hd::kCurrentForce, force_n.data());
  hd_.end_frame(connection_.handle);

  Count(counts_.forces_written);
  if (was_stopping) zero_frames_.fetch_add(1, std::memory_order_release);
  const bool is_good = TakeErrors(now_ns);
  if (!is_good || lost()) return;
  if (!is_whole) {
    Count(counts_.corrupt_frames);
    return;
  }
  docked_.store(reading.docked, std::memory_order_relaxed);
  readings_.Write(reading);
  Count(counts_.readings);
  has_reading_.store(true, std::memory_order_release);
}

// Called outside of the frame, as the open drivers do. The library says when it can calibrate by
// itself, for example in the inkwell. An encoder reset needs the operator: only the operator knows
// whether the arm is held in the reset pose.
void HdServo::Calibrate() noexcept {
  const hd::Enum style = connection_.calibration_style;
  if (style == 0) {
    calibrated_.store(true, std::memory_order_relaxed);
    return;
  }
  const hd::Enum status = hd_.check_calibration();
  calibrated_.store(status == hd::kCalibrationOk, std::memory_order_relaxed);
  if (frames_to_calibration_ > 0) --frames_to_calibration_;
  const bool by_itself = status == hd::kCalibrationNeedsUpdate && style != hd::kStyleEncoderReset;
  const bool by_request = calibration_requested_.load(std::memory_order_relaxed) &&
                          (style != hd::kStyleInkwell || docked());
  if ((!by_itself && !by_request) || frames_to_calibration_ > 0) return;
  frames_to_calibration_ = kCalibrationFrames;
  calibration_requested_.store(false, std::memory_order_relaxed);
  hd_.update_calibration(style);
  // The position may jump, so this frame's position has no meaning.
  calibrated_.store(false, std::memory_order_relaxed);
  Count(counts_.calibrations);
}

bool HdServo::TakeReading(Reading& reading) noexcept {
  int buttons = 0;
  hd_.get_integerv(hd::kCurrentButtons, &buttons);
  reading.buttons = static_cast<std::uint32_t>(buttons);
  // A device without an inkwell may return anything.
  if (connection_.calibration_style == hd::kStyleInkwell) {
    hd::Boolean is_out = 1;
    hd_.get_booleanv(hd::kCurrentInkwellSwitch, &is_out);
    reading.docked = is_out == 0;
  }
  reading.calibrated = calibrated();

  // If the library fails, it may leave the values untouched. NaN then marks them as no reading.
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  reading.p_DHip_mm.fill(kNan);
  hd_.get_doublev(hd::kCurrentPosition, reading.p_DHip_mm.data());
  Eigen::Matrix4d X_DS = Eigen::Matrix4d::Constant(kNan);  // column-major, as the library's
  hd_.get_doublev(hd::kCurrentTransform, X_DS.data());
  const Eigen::Matrix3d R_DS = X_DS.topLeftCorner<3, 3>();
  const bool has_position =
      std::ranges::all_of(reading.p_DHip_mm, [](double mm) { return std::isfinite(mm); });
  if (!has_position || !IsRotation(R_DS)) return false;
  const Eigen::Vector4d xyzw = Eigen::Quaterniond(R_DS).normalized().coeffs();
  reading.R_DS_xyzw = {xyzw[0], xyzw[1], xyzw[2], xyzw[3]};
  return true;
}

std::optional<Vec3> HdServo::NextForce(std::int64_t now_ns) noexcept {
  const Command& command = commands_.Read();
  if (stopping_.load(std::memory_order_acquire) || lost() || command.at_ns == 0) {
    return std::nullopt;
  }
  const Vec3 force_D_n(command.force_D_n.data());
  if (now_ns - command.at_ns > kServoSilentMs * kNsPerMs) {
    Count(counts_.watchdog_zeros);
    watchdog_holds_.store(true, std::memory_order_relaxed);
    return std::nullopt;
  }
  if (force_D_n.isZero()) watchdog_holds_.store(false, std::memory_order_relaxed);
  if (!command.motors_on || watchdog_holds_.load(std::memory_order_relaxed)) return std::nullopt;
  if (now_ns < force_error_until_ns_.load(std::memory_order_relaxed)) return std::nullopt;
  return Limited(force_D_n, connection_.max_force_n);
}

// Errors of these calls are taken together with the frame's errors.
void HdServo::SetMotors(bool on) noexcept {
  if (on == motors_on_) return;
  motors_on_ = on;
  if (on) {
    hd_.enable(hd::kForceOutput);
  } else {
    hd_.disable(hd::kForceOutput);
  }
}

bool HdServo::TakeErrors(std::int64_t now_ns) noexcept {
  hd::ErrorEffect worst = hd::ErrorEffect::kNone;
  for (int i = 0; i < kMostErrorsAFrame; ++i) {
    const hd::ErrorInfo error = hd_.get_error();
    const hd::ErrorEffect effect = hd::EffectOf(error.code);
    if (effect == hd::ErrorEffect::kNone) break;
    if (effect != hd::ErrorEffect::kWarning && effect != hd::ErrorEffect::kForce) {
      Count(counts_.transfer_errors);
    }
    if (effect > worst) worst = effect;
    errors_.TryPush(error);
    if (effect == hd::ErrorEffect::kForce) {
      force_error_until_ns_.store(now_ns + kForceErrorMs * kNsPerMs, std::memory_order_relaxed);
    }
  }
  const bool is_good = worst < hd::ErrorEffect::kFrame;
  bad_frames_ = is_good ? 0 : bad_frames_ + 1;
  if (worst == hd::ErrorEffect::kBroken || bad_frames_ >= kLostFrames) {
    lost_.store(true, std::memory_order_release);
  }
  return is_good;
}

DeviceStatus HdServo::Read(DeviceState& state) noexcept {
  const Reading& newest = readings_.Read();
  if (newest.at_ns == 0) return DeviceStatus::kFault;
  state.p_DHip_mm = Vec3(newest.p_DHip_mm.data());
  state.R_DS = Eigen::Quaterniond(newest.R_DS_xyzw.data());
  state.buttons = newest.buttons;
  state.docked = newest.docked;
  state.calibrated = newest.calibrated;
  const std::int64_t now_ns = NowNs();
  const std::int64_t age_ns = now_ns - newest.at_ns;
  const bool is_gone = !streaming_.load(std::memory_order_acquire) || !has_reading() || lost();
  if (is_gone || age_ns > kSilentMs * kNsPerMs ||
      now_ns < force_error_until_ns_.load(std::memory_order_relaxed)) {
    return DeviceStatus::kFault;
  }
  const bool is_stale =
      age_ns > kStaleAfterMs * kNsPerMs || watchdog_holds_.load(std::memory_order_relaxed);
  return is_stale ? DeviceStatus::kStale : DeviceStatus::kOk;
}

void HdServo::Write(const Vec3& force_D_n, bool motors_on) noexcept {
  commands_.Write({.force_D_n = {force_D_n.x(), force_D_n.y(), force_D_n.z()},
                   .motors_on = motors_on,
                   .at_ns = NowNs()});
}

double HdServo::silent_ms() const noexcept {
  return static_cast<double>(NowNs() - frame_ns_.load(std::memory_order_relaxed)) / kNsPerMs;
}

}  // namespace palpate
