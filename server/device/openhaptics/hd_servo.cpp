#include "server/device/openhaptics/hd_servo.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "server/device/stream/vendor_library.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

constexpr std::int64_t kNsPerMs = 1'000'000;
// A faulty library might return errors without end. It must not hold up the thread.
constexpr int kMostErrorsAFrame = 8;
// The least time between two requests to calibrate, because a request may write to the device.
constexpr int kCalibrationFrames = 100;

Vec3 Limited(const Vec3& force_n, double max_force_n) noexcept {
  const double size_n = force_n.stableNorm();
  return size_n > max_force_n ? Vec3(force_n * (max_force_n / size_n)) : force_n;
}

}  // namespace

void HdServo::Begin(const HdConnection& connection) noexcept {
  connection_ = connection;
  reading_ = {};
  worst_ = hd::ErrorEffect::kNone;
  bad_frames_ = 0;
  frames_since_lost_ = 0;
  frames_to_calibration_ = 0;
  motors_on_.store(false);
  stopping_.store(false);
  lost_.store(false);
  has_reading_.store(false);
  zero_frames_.store(0);
  force_error_until_ns_.store(0);
  frame_ns_.store(MonotonicNowNs());
}

hd::CallbackCode HdLoop::Frame(void* self) noexcept {
  HdLoop& loop = *static_cast<HdLoop*>(self);
  for (HdServo* device : loop.devices_) {
    device->RunFrame();
    loop.TakeErrors(*device);
    device->FinishFrame();
  }
  return hd::kCallbackContinue;
}

void HdLoop::TakeErrors(HdServo& newest) noexcept {
  for (int n = 0; n < kMostErrorsAFrame; ++n) {
    const hd::ErrorInfo error = hd_.get_error();
    if (hd::EffectOf(error.code) == hd::ErrorEffect::kNone) return;
    const auto named = std::ranges::find(devices_, error.handle, &HdServo::handle);
    (named != devices_.end() ? **named : newest).TakeError(error);
  }
}

void HdServo::RunFrame() noexcept {
  frame_ns_.store(MonotonicNowNs(), std::memory_order_relaxed);
  ran_frame_ = !lost() || frames_since_lost_++ < kLostFrames;
  if (!ran_frame_) return;
  const bool was_stopping = stopping_.load(std::memory_order_acquire);
  hd_.make_current(connection_.handle);
  reading_.calibrated = Calibrate();
  const std::optional<Vec3> next = NextForce();
  SetMotors(next.has_value());
  hd_.begin_frame(connection_.handle);
  is_whole_ = TakeReading();
  const Vec3 force_M_n = next.value_or(Vec3::Zero());
  hd_.set_doublev(hd::kCurrentForce, force_M_n.data());
  hd_.end_frame(connection_.handle);
  seat.CountSent();
  if (was_stopping) zero_frames_.fetch_add(1, std::memory_order_release);
}

void HdServo::TakeError(const hd::ErrorInfo& error) noexcept {
  const hd::ErrorEffect effect = hd::EffectOf(error.code);
  if (effect == hd::ErrorEffect::kForce) {
    force_error_until_ns_.store(MonotonicNowNs() + kForceErrorMs * kNsPerMs,
                                std::memory_order_relaxed);
  } else if (effect != hd::ErrorEffect::kWarning) {
    ++seat.counts.transfer_errors;
  }
  worst_ = std::max(worst_, effect);
  errors_.TryPush(error);
}

void HdServo::FinishFrame() noexcept {
  if (!ran_frame_) return;
  const hd::ErrorEffect worst = std::exchange(worst_, hd::ErrorEffect::kNone);
  const bool is_good = worst < hd::ErrorEffect::kFrame;
  bad_frames_ = is_good ? 0 : bad_frames_ + 1;
  if (worst == hd::ErrorEffect::kBroken || bad_frames_ >= kLostFrames) {
    lost_.store(true, std::memory_order_release);
  }
  if (!is_good || lost()) return;
  if (!is_whole_) {
    ++seat.counts.corrupt_frames;
    return;
  }
  seat.Take(reading_, frame_ns_.load(std::memory_order_relaxed));
  ++seat.counts.readings;
  has_reading_.store(true, std::memory_order_release);
}

// Called outside of the frame, as the open drivers do. The library says when it can calibrate by
// itself, for example in the inkwell. An encoder reset needs the operator: only the operator knows
// whether the arm is held in the reset pose.
bool HdServo::Calibrate() noexcept {
  const hd::Enum style = connection_.calibration_style;
  if (style == 0) return true;
  const hd::Enum status = hd_.check_calibration();
  if (frames_to_calibration_ > 0) --frames_to_calibration_;
  const bool by_itself = status == hd::kCalibrationNeedsUpdate && style != hd::kStyleEncoderReset;
  const bool by_request = calibration_requested_.load(std::memory_order_relaxed) &&
                          (style != hd::kStyleInkwell || reading_.docked);
  if ((!by_itself && !by_request) || frames_to_calibration_ > 0) {
    return status == hd::kCalibrationOk;
  }
  frames_to_calibration_ = kCalibrationFrames;
  calibration_requested_.store(false, std::memory_order_relaxed);
  hd_.update_calibration(style);
  ++calibrations_;
  seat.Hold();
  return false;  // the position may jump
}

bool HdServo::TakeReading() noexcept {
  int buttons = 0;
  hd_.get_integerv(hd::kCurrentButtons, &buttons);
  reading_.buttons = static_cast<std::uint32_t>(buttons);
  // A device without an inkwell may return anything.
  reading_.docked = false;
  if (connection_.calibration_style == hd::kStyleInkwell) {
    hd::Boolean is_out = 1;
    hd_.get_booleanv(hd::kCurrentInkwellSwitch, &is_out);
    reading_.docked = is_out == 0;
  }
  // If the library fails, it may leave the values untouched. NaN then marks them as no reading.
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  reading_.p_MHip_mm.setConstant(kNan);
  hd_.get_doublev(hd::kCurrentPosition, reading_.p_MHip_mm.data());
  Eigen::Matrix4d X_MS = Eigen::Matrix4d::Constant(kNan);  // column-major, as the library's
  hd_.get_doublev(hd::kCurrentTransform, X_MS.data());
  const Eigen::Matrix3d R_MS = X_MS.topLeftCorner<3, 3>();
  if (!reading_.p_MHip_mm.allFinite() || !IsRotation(R_MS)) return false;
  reading_.R_MS = Eigen::Quaterniond(R_MS).normalized();
  return true;
}

std::optional<Vec3> HdServo::NextForce() noexcept {
  if (stopping_.load(std::memory_order_acquire) || lost()) return std::nullopt;
  const DeviceCommand command = seat.Next();
  if (!command.motors_on) return std::nullopt;
  if (MonotonicNowNs() < force_error_until_ns_.load(std::memory_order_relaxed)) return std::nullopt;
  return Limited(command.wrench_M.force_n, connection_.max_force_n);
}

// Errors of these calls are taken together with the frame's errors.
void HdServo::SetMotors(bool on) noexcept {
  if (on == motors_on()) return;
  motors_on_.store(on, std::memory_order_relaxed);
  if (on) {
    hd_.enable(hd::kForceOutput);
  } else {
    hd_.disable(hd::kForceOutput);
  }
}

DeviceStatus HdServo::Read(DeviceState& state) noexcept {
  const DeviceStatus status = seat.Read(state);
  const bool is_refused =
      lost() || MonotonicNowNs() < force_error_until_ns_.load(std::memory_order_relaxed);
  return is_refused ? DeviceStatus::kFault : status;
}

double HdServo::silent_ms() const noexcept {
  return static_cast<double>(MonotonicNowNs() - frame_ns_.load(std::memory_order_relaxed)) /
         kNsPerMs;
}

}  // namespace palpate
