// The code that runs in the HD library's own 1 kHz thread, and its exchange with the servo. Each
// callback runs one frame, which takes a reading and puts the newest force on the hand.
//
// If the servo does not write for kServoSilentMs, the frames write zero force and Read returns
// kStale. This lasts until the servo writes zero force. The motors are enabled only while there may
// be force.
// After a force error of the library, the force is zero for kForceErrorMs. The device counts as
// lost after kLostFrames frames in a row without a reading, or after one broken frame. The force is
// then zero until the control thread releases the device.
//
// Frame: D (mm, N). Threads: Frame on the library's thread; Read and Write on the servo thread; the
// others on the control thread, Begin only while nothing is scheduled.
// Real-time: Read and Write are wait-free. Frame does not allocate, lock or throw, except inside
// the library.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>

#include "server/device/haptic_device.h"
#include "server/device/openhaptics/hd_api.h"
#include "server/realtime/latest_value.h"
#include "server/realtime/spsc_ring.h"

namespace palpate {

// A connection that is set up.
struct HdConnection {
  hd::Handle handle = hd::kInvalidHandle;
  double max_force_n = 0.0;
  hd::Enum calibration_style = 0;  // 0: the device needs no calibration
};

struct HdCounts {
  std::atomic<std::uint64_t> readings{0};
  std::atomic<std::uint64_t> forces_written{0};
  std::atomic<std::uint64_t> corrupt_frames{0};
  std::atomic<std::uint64_t> transfer_errors{0};
  std::atomic<std::uint64_t> watchdog_zeros{0};
  std::atomic<std::uint64_t> calibrations{0};
};

class HdServo {
 public:
  static constexpr int kStaleAfterMs = 4;
  static constexpr int kServoSilentMs = 5;
  static constexpr int kSilentMs = 100;
  static constexpr int kForceErrorMs = 500;
  static constexpr int kLostFrames = 10;

  // functions: must outlive this object.
  explicit HdServo(const hd::Functions& functions) : hd_(functions) {}

  // Starts a connection. Readings come from now on.
  void Begin(const HdConnection& connection) noexcept;
  // Ends the connection. Read then returns kFault.
  void End() noexcept { streaming_.store(false, std::memory_order_release); }
  // The callback for the library's scheduler, with this object as user data.
  static hd::CallbackCode Frame(void* self) noexcept;

  DeviceStatus Read(DeviceState& state) noexcept;
  void Write(const Vec3& force_D_n, bool motors_on) noexcept;

  // Makes the force zero until Begin.
  void BeginToStop() noexcept { stopping_.store(true, std::memory_order_release); }
  // The number of frames with zero force since BeginToStop.
  std::uint64_t zero_frames() const { return zero_frames_.load(std::memory_order_acquire); }
  bool lost() const { return lost_.load(std::memory_order_acquire); }
  // The time since the last frame began; before the first frame, the time since Begin.
  double silent_ms() const noexcept;
  bool has_reading() const { return has_reading_.load(std::memory_order_acquire); }

  void RequestCalibration() noexcept { calibration_requested_.store(true); }
  // Takes the oldest error of the frames. Errors beyond the ring's capacity are dropped.
  bool TryPopError(hd::ErrorInfo& error) noexcept { return errors_.TryPop(error); }

  const HdCounts& counts() const { return counts_; }
  bool docked() const { return docked_.load(std::memory_order_relaxed); }
  bool calibrated() const { return calibrated_.load(std::memory_order_relaxed); }

 private:
  // Plain numbers: their copies do not throw. Eigen's types do not promise that.
  struct Reading {
    std::array<double, 3> p_DHip_mm{};
    std::array<double, 4> R_DS_xyzw{};
    std::uint32_t buttons = 0;
    bool docked = false;
    bool calibrated = false;
    std::int64_t at_ns = 0;  // 0: no reading yet
  };
  struct Command {
    std::array<double, 3> force_D_n{};
    bool motors_on = false;
    std::int64_t at_ns = 0;  // 0: no command yet
  };

  void RunFrame() noexcept;
  void Calibrate() noexcept;
  bool TakeReading(Reading& reading) noexcept;
  // None: the motors must be off.
  std::optional<Vec3> NextForce(std::int64_t now_ns) noexcept;
  void SetMotors(bool on) noexcept;
  // Returns true if the frame's reading is good.
  bool TakeErrors(std::int64_t now_ns) noexcept;

  hd::Functions hd_;
  HdConnection connection_;
  LatestValue<Reading> readings_;
  LatestValue<Command> commands_;
  SpscRing<hd::ErrorInfo, 64> errors_;
  HdCounts counts_;

  // Used by the library's thread only, while frames come.
  bool motors_on_ = false;
  int bad_frames_ = 0;             // in a row
  int frames_to_calibration_ = 0;  // until the library may be asked again

  std::atomic<bool> streaming_{false};
  std::atomic<bool> stopping_{false};
  std::atomic<bool> lost_{false};
  std::atomic<bool> has_reading_{false};
  std::atomic<bool> docked_{false};
  std::atomic<bool> calibrated_{false};
  std::atomic<bool> calibration_requested_{false};
  std::atomic<bool> watchdog_holds_{false};
  std::atomic<std::uint64_t> zero_frames_{0};
  std::atomic<std::int64_t> frame_ns_{0};
  std::atomic<std::int64_t> force_error_until_ns_{0};
};

}  // namespace palpate
