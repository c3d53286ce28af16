// The seam between the servo loop and a force-feedback device.
//
// A device of the simulation computes in Read and Write. A real one has an I/O thread
// of its own: Read and Write exchange newest values with it and touch no bus.
//
// Frame D: mm, x right, y up, z towards the user; forces in N.
// Threads: Start and Stop on the main thread; Read and Write on the servo thread only,
// once a tick, in this order; health and Calibrate on any ordinary thread; NextEvent
// on one ordinary thread. Read and Write never lock, allocate, log, throw or wait.
// Ownership: the servo borrows the device; the assembly owns it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/geometry/geometry.h"

namespace palpate {

// What of a device's behaviour we have seen on hardware, each including those above
// it. It belongs to the program and is raised with evidence (deploy/guides/devices.md);
// that a device answers at this moment does not raise it.
enum class VerificationLevel {
  kNone,
  kEnumerated,     // found, opened and claimed
  kIdentified,     // answered who it is
  kStateRead,      // positions and buttons are right
  kForceVerified,  // forces have the right direction and size
  kSimulated,      // there is no hardware to verify
};

std::string_view NameOf(VerificationLevel level);

struct DeviceSpec {
  std::string kind;   // configuration name, such as "simulated"
  std::string model;  // for people
  Vec3 workspace_min_mm = Vec3::Zero();
  Vec3 workspace_max_mm = Vec3::Zero();
  double max_force_n = 0.0;
  double continuous_force_n = 0.0;      // that it bears for ever
  double max_stiffness_n_per_mm = 0.0;  // that it renders steadily
  double position_resolution_mm = 0.0;
  int button_count = 0;
  VerificationLevel verification_level = VerificationLevel::kNone;
};

// There are motors: every limit of the safety stage applies, and forces are off until
// the operator enables them.
inline bool IsHardware(const DeviceSpec& spec) {
  return spec.verification_level != VerificationLevel::kSimulated;
}

// One reading.
struct DeviceState {
  Vec3 p_DHip_mm = Vec3::Zero();                             // stylus tip
  Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();  // stylus axes to D
  std::uint32_t buttons = 0;                                 // bit n: button n pressed
  bool docked = false;                                       // the stylus rests in its holder
  bool calibrated = true;                                    // the position has a meaning
};

enum class DeviceStatus : std::uint8_t {
  kOk,
  // No new reading for longer than its period, the state is the last good one; or zero
  // was written in the servo's place, and stays until the servo writes zero: the old
  // force must not come back in one step.
  kStale,
  kFault,  // the device is gone or broken; forces must stay off
};

enum class DeviceConnection : std::uint8_t {
  kAbsent,      // not found, or not to be opened; looked for again and again
  kConnecting,  // found; being set up
  kStreaming,   // readings come
};

// For people and the metrics; counts since Start.
struct DeviceHealth {
  DeviceConnection connection = DeviceConnection::kAbsent;
  bool docked = false;
  bool calibrated = false;
  std::string identity{};  // serial number and firmware as the device says; "": unknown
  std::string problem{};   // what is wrong and what to do, one line; "": nothing
  std::uint64_t readings = 0;
  std::uint64_t forces_written = 0;
  std::uint64_t lost_readings = 0;   // by gaps in their numbers
  std::uint64_t corrupt_frames = 0;  // dropped
  std::uint64_t transfer_errors = 0;
  std::uint64_t connections = 0;
  std::uint64_t watchdog_zeros = 0;  // zero forces because the servo did not tick
};

// A line for the log.
struct DeviceEvent {
  enum class Level : std::uint8_t { kInfo, kWarning, kError };
  Level level = Level::kInfo;
  std::string text{};
};

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;

  virtual const DeviceSpec& spec() const = 0;

  // Opens the device, or begins to look for it: one that may be plugged in later is
  // no error. Throws Error with what is wrong and what to do.
  virtual void Start() = 0;
  // Zero force, then closes the device. Safe to call twice.
  virtual void Stop() noexcept = 0;

  // Newest state of the stylus.
  virtual DeviceStatus Read(DeviceState& state) noexcept = 0;
  // Force on the hand, already limited. dt_s: time since the last Write; a
  // simulation moves on by it.
  virtual void Write(const Vec3& force_D_n, double dt_s) noexcept = 0;
  // Before Write, where it matters: whether motors may have current at all. Until told
  // otherwise, they may not.
  virtual void SetMotors(bool /*on*/) noexcept {}

  virtual DeviceHealth health() const {
    return {.connection = DeviceConnection::kStreaming, .calibrated = true};
  }
  // What has happened since the last call, oldest first; none when that is all.
  virtual std::optional<DeviceEvent> NextEvent() { return std::nullopt; }
  // Takes the stylus's place of rest as where it is when it is docked next, or now
  // where it is docked. Throws Error (kInvalidArgument) for a device without
  // one.
  virtual void Calibrate();
};

}  // namespace palpate
