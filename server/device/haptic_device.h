// The seam between the servo loop and a force-feedback device.
//
// Frame D: mm, x right, y up, z towards the user; forces in N.
// Threads: Start and Stop on the main thread; Read and Write on the servo
// thread only, once a tick, in this order. Read and Write never lock, allocate,
// log, throw or wait.
// Ownership: the servo borrows the device; the assembly owns it.
#pragma once

#include <cstdint>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

// What of a device's behaviour has been seen on hardware.
enum class VerificationLevel {
  kNone,
  kEnumerated,
  kIdentified,
  kStateRead,
  kForceVerified,
  kSimulated,  // there is no hardware to verify
};

struct DeviceSpec {
  std::string kind;   // configuration name, such as "simulated"
  std::string model;  // for people
  Vec3 workspace_min_mm = Vec3::Zero();
  Vec3 workspace_max_mm = Vec3::Zero();
  double max_force_n = 0.0;
  double continuous_force_n = 0.0;
  double position_resolution_mm = 0.0;
  int button_count = 0;
  VerificationLevel verification_level = VerificationLevel::kNone;
};

// One reading.
struct DeviceState {
  Vec3 p_DHip_mm = Vec3::Zero();                             // stylus tip
  Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();  // stylus axes to D
  std::uint32_t buttons = 0;                                 // bit n: button n pressed
};

enum class DeviceStatus : std::uint8_t {
  kOk,
  kStale,  // no new reading; the state is the last good one
  kFault,  // the device is gone or broken; forces must stay off
};

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;

  virtual const DeviceSpec& spec() const = 0;

  // Opens the device. Throws Error with what is wrong and what to do.
  virtual void Start() = 0;
  // Zero force, then closes the device. Safe to call twice.
  virtual void Stop() noexcept = 0;

  // Newest state of the stylus.
  virtual DeviceStatus Read(DeviceState& state) noexcept = 0;
  // Force on the hand, already limited. dt_s: time since the last Write; a
  // simulation moves on by it.
  virtual void Write(const Vec3& force_D_n, double dt_s) noexcept = 0;
};

}  // namespace palpate
