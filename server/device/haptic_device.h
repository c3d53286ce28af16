// The interface between the servo loop and a force-feedback device.
//
// A simulated device computes in Read and Write. A real device has its own I/O thread: Read and
// Write exchange the newest values with that thread and do not touch a bus.
//
// Frame M, the device's own: mm, x right, y up, z towards the user; forces in N, torques in N mm.
// The servo computes in D. M is D until a device can be mounted otherwise.
// Threads: Start and Stop on the main thread. Read and Write on the servo thread only, once a tick,
// in this order. health and Calibrate on any ordinary thread. NextEvent on one ordinary thread.
// Read and Write never lock, allocate, log, throw or wait.
// Ownership: RunDaemon owns the device; the servo borrows it.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

#include "common/contract/device.h"
#include "common/contract/enumerations.h"
#include "common/geometry/wrench.h"

namespace palpate {

// True if the device has motors. All limits of the safety stage then apply, and forces are off
// until the operator enables them.
inline bool IsHardware(const DeviceDescription& spec) {
  return spec.verification_level != VerificationLevel::kSimulated;
}

// A place that is none: three NaN.
inline const Vec3 kNowhere = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());

// One reading.
struct DeviceState {
  Vec3 p_MHip_mm = Vec3::Zero();                             // stylus tip
  Eigen::Quaterniond R_MS = Eigen::Quaterniond::Identity();  // stylus axes to M
  std::uint32_t buttons = 0;                                 // bit n: button n pressed
  bool docked = false;                                       // the stylus rests in its holder
  bool calibrated = true;                                    // the position has a meaning
  Vec3 p_MLed_mm = kNowhere;  // where somebody leads the simulated hand
};

// What the motors are to do.
struct DeviceCommand {
  Wrench wrench_M{};       // on the hand, about the point that Read reports
  bool motors_on = false;  // whether the motors may have current
};

// One line for the log.
struct DeviceEvent {
  enum class Level : std::uint8_t { kInfo, kWarning, kError };
  Level level = Level::kInfo;
  std::string text{};
};

// Throws Error (kInvalidArgument): a device of this kind has no place of rest.
[[noreturn]] void RefuseCalibration(const std::string& kind);

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;

  virtual const DeviceDescription& spec() const = 0;

  // Opens the device, or starts to look for it. A missing device that can be plugged in later is no
  // error. Throws Error with what is wrong and what to do.
  virtual void Start() = 0;
  // Writes zero force, then closes the device. A second call does nothing.
  virtual void Stop() noexcept = 0;

  // Gets the newest state of the stylus.
  virtual DeviceStatus Read(DeviceState& state) noexcept = 0;
  // Writes the force and torque on the hand, which are already limited. The motors have no current
  // before the first Write. dt_s: time since the last Write; a simulated device moves on by it.
  virtual void Write(const DeviceCommand& command, double dt_s) noexcept = 0;

  virtual DeviceHealth health() const {
    return {.connection = DeviceConnection::kStreaming, .calibrated = true};
  }
  // Returns the oldest event that was not returned yet; none if there is no such event.
  virtual std::optional<DeviceEvent> NextEvent() { return std::nullopt; }
  // Sets the stylus's place of rest: the present place if the stylus is docked, else the place of
  // the next docking. Throws Error (kInvalidArgument) if the device has no place of rest.
  virtual void Calibrate() { RefuseCalibration(spec().kind); }
  // Ends what the device does by itself, such as a calibration in which its arm moves. Any thread,
  // also the servo's: no lock, no allocation, no log, no wait.
  virtual void StopMoving() noexcept {}
  // True from the announcement of such a motion to its end. Any thread.
  virtual bool moves_by_itself() const noexcept { return false; }
};

}  // namespace palpate
