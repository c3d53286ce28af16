// What runs in the HD library's own 1 kHz thread: a frame for each device, which takes a reading
// and puts the newest force on the hand. The exchange with the servo is a DeviceSeat.
//
// The library acts on its current device, so each frame begins by making its device current. Errors
// go to the device that they name, else to the one whose frame ran last.
// The motors are enabled only while there may be force. After a force error of the library, the
// force is zero for kForceErrorMs. A device counts as lost after kLostFrames frames in a row
// without a reading, or after one broken frame. It gets kLostFrames more frames with zero force,
// then none.
//
// Frame: M (mm, N). Threads: HdLoop::Frame on the library's thread; Read on the servo thread; the
// others on the control thread, Begin only while nothing is scheduled.
// Real-time: Read is wait-free. Frame does not allocate, lock or throw, except inside the library.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/device/openhaptics/hd_library.h"
#include "server/device/stream/device_seat.h"
#include "server/realtime/spsc_ring.h"

namespace palpate {

// A device that is set up.
struct HdConnection {
  hd::Handle handle = hd::kInvalidHandle;
  double max_force_n = 0.0;
  hd::Enum calibration_style = 0;  // 0: the device needs no calibration
};

class HdServo {
 public:
  static constexpr int kForceErrorMs = 500;
  static constexpr int kLostFrames = 10;

  // functions: must outlive this object. name: of the device in the log.
  HdServo(const hd::Functions& functions, const std::string& name) : seat(name), hd_(functions) {}

  DeviceSeat seat;
  // As DeviceSeat::Read; also kFault while the library refuses forces.
  DeviceStatus Read(DeviceState& state) noexcept;

  // Starts a connection.
  void Begin(const HdConnection& connection) noexcept;
  // Makes the force zero until Begin.
  void BeginToStop() noexcept { stopping_.store(true, std::memory_order_release); }
  // The number of frames with zero force since BeginToStop.
  std::uint64_t zero_frames() const { return zero_frames_.load(std::memory_order_acquire); }
  bool lost() const { return lost_.load(std::memory_order_acquire); }
  bool has_reading() const { return has_reading_.load(std::memory_order_acquire); }
  bool motors_on() const { return motors_on_.load(std::memory_order_relaxed); }
  // The time since the last frame began; before the first frame, the time since Begin.
  double silent_ms() const noexcept;
  hd::Handle handle() const { return connection_.handle; }
  hd::Enum calibration_style() const { return connection_.calibration_style; }

  void RequestCalibration() noexcept { calibration_requested_.store(true); }
  std::uint64_t calibrations() const { return calibrations_; }
  // Takes the oldest error of the frames. Errors beyond the ring's capacity are dropped.
  bool TryPopError(hd::ErrorInfo& error) noexcept { return errors_.TryPop(error); }

 private:
  friend class HdLoop;

  void RunFrame() noexcept;
  void TakeError(const hd::ErrorInfo& error) noexcept;
  // Judges the frame by its errors.
  void FinishFrame() noexcept;
  // Returns whether the position has a meaning.
  bool Calibrate() noexcept;
  bool TakeReading() noexcept;
  // None: the motors must be off.
  std::optional<Vec3> NextForce() noexcept;
  void SetMotors(bool on) noexcept;

  hd::Functions hd_;
  HdConnection connection_;
  SpscRing<hd::ErrorInfo, 64> errors_;

  // Used by the library's thread only, while frames come.
  DeviceState reading_;
  bool is_whole_ = false;                           // this frame's reading
  bool ran_frame_ = false;                          // in this callback
  hd::ErrorEffect worst_ = hd::ErrorEffect::kNone;  // since the last judgement
  int bad_frames_ = 0;                              // in a row
  int frames_since_lost_ = 0;
  int frames_to_calibration_ = 0;  // until the library may be asked again

  std::atomic<bool> motors_on_{false};
  std::atomic<bool> stopping_{false};
  std::atomic<bool> lost_{false};
  std::atomic<bool> has_reading_{false};
  std::atomic<bool> calibration_requested_{false};
  std::atomic<std::uint64_t> calibrations_{0};
  std::atomic<std::uint64_t> zero_frames_{0};
  std::atomic<std::int64_t> frame_ns_{0};
  std::atomic<std::int64_t> force_error_until_ns_{0};
};

// The frames of all devices, one after the other.
class HdLoop {
 public:
  explicit HdLoop(const hd::Functions& functions) : hd_(functions) {}

  // The devices of the next frames; borrowed. Call it while nothing is scheduled.
  void Set(std::vector<HdServo*> devices) { devices_ = std::move(devices); }
  // The callback for the library's scheduler, with a loop as user data.
  static hd::CallbackCode Frame(void* loop) noexcept;

 private:
  void TakeErrors(HdServo& newest) noexcept;

  hd::Functions hd_;
  std::vector<HdServo*> devices_;
};

}  // namespace palpate
