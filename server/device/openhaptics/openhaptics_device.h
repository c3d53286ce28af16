// A HapticDevice over the vendor's OpenHaptics (its HD library and device driver), for example a
// Phantom Omni or a Touch on a workstation with OpenHaptics.
//
// The library runs frames on its own 1 kHz thread (hd_servo.h). A thread of ours sets the device
// up, watches it and releases it (hd_control.h). If the device is missing, lost or silent, that
// thread looks for it again every DeviceLink::kRetry.
//
// Frame M is the library's: mm, x right, y up, z towards the user.
// Threads: as HapticDevice. Of the library's functions, those of a frame run on the library's
// thread, all others on our own.
// Real-time: Read and Write are wait-free.
// Ownership: one such device per process, because the library has one scheduler.
// Errors: Start throws Error if the library is missing. A missing device is no error.
// Verification level: none; we have not seen it work with hardware.
#pragma once

#include <memory>
#include <string>

#include "server/device/haptic_device.h"
#include "server/device/openhaptics/hd_control.h"

namespace palpate {

struct OpenHapticsOptions {
  std::string library = HdLibrary::kDefaultPath;
  std::string device_name{};  // as in the vendor's set-up; "": its default device
};

class OpenHapticsDevice final : public HapticDevice {
 public:
  // The longest that Stop waits for the library. A library that hangs is left alone, with zero
  // force.
  static constexpr int kStopMs = 2000;

  explicit OpenHapticsDevice(OpenHapticsOptions options);
  ~OpenHapticsDevice() override;

  // The datasheet's values of the Touch. If the library states a lower maximum force, that one
  // applies.
  const DeviceDescription& spec() const override { return spec_; }
  void Start() override;
  void Stop() noexcept override;
  DeviceStatus Read(DeviceState& state) noexcept override;
  void Write(const DeviceCommand& command, double dt_s) noexcept override;
  DeviceHealth health() const override;
  std::optional<DeviceEvent> NextEvent() override;
  // With an inkwell, calibrates when the stylus is next in the inkwell; without one, calibrates at
  // once at the present position. Throws Error (kInvalidArgument) if the device needs no
  // calibration.
  void Calibrate() override;

 private:
  OpenHapticsOptions options_;
  DeviceDescription spec_;
  // Shared with the thread, which outlives this object if the library hangs.
  std::shared_ptr<HdControl> control_;
  bool is_started_ = false;
};

}  // namespace palpate
