// A HapticDevice over the vendor's OpenHaptics (its HD library and device driver), such
// as a Phantom Omni or a Touch on a workstation where they are installed.
//
// The library runs frames on its own 1 kHz thread (hd_servo.h). A control thread sets
// the device up, watches it, and lets go of it; one that is not there, is lost or
// silent is looked for again every HdControl::kRetryMs.
//
// Frame D is the library's: mm, x right, y up, z towards the user.
// Threads: as HapticDevice; of the library's functions, those of a frame are on its
// own thread, all others on the control thread.
// Real-time: Read and Write are wait-free.
// Ownership: one such device a process, for the library has one scheduler.
// Errors: Start throws Error where the library is missing. A device that is not there
// is no error.
// Verification level: none; not seen with hardware.
#pragma once

#include <memory>
#include <string>

#include "server/device/haptic_device.h"
#include "server/device/openhaptics/hd_library.h"

namespace palpate {

struct OpenHapticsOptions {
  std::string library = HdLibrary::kDefaultPath;
  std::string device_name{};  // as in the vendor's set-up; "": its default device
};

class OpenHapticsDevice final : public HapticDevice {
 public:
  // Stop waits no longer for the library. What hangs is left to itself, with zero force.
  static constexpr int kStopMs = 2000;

  explicit OpenHapticsDevice(OpenHapticsOptions options);
  ~OpenHapticsDevice() override;

  // The datasheet's numbers of the Touch. Where the library states a lower greatest
  // force, that is kept to.
  const DeviceSpec& spec() const override { return spec_; }
  void Start() override;
  void Stop() noexcept override;
  DeviceStatus Read(DeviceState& state) noexcept override;
  void Write(const Vec3& force_D_n, double dt_s) noexcept override;
  void SetMotors(bool on) noexcept override { motors_on_ = on; }
  DeviceHealth health() const override;
  std::optional<DeviceEvent> NextEvent() override;
  // In the inkwell, when the stylus is there next; other devices at once, where they
  // are. Throws Error (kInvalidArgument) for a device that needs none.
  void Calibrate() override;

 private:
  struct Control;

  OpenHapticsOptions options_;
  bool motors_on_ = false;  // the servo's
  DeviceSpec spec_;
  // Shared with the control thread, which may outlive this where the library hangs.
  std::shared_ptr<Control> control_;
};

}  // namespace palpate
