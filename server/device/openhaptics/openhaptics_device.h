// A HapticDevice over the vendor's OpenHaptics (its HD library and device driver), for example a
// Phantom Omni or a Touch on a workstation with OpenHaptics.
//
// The library runs frames on its own 1 kHz thread (hd_servo.h). A thread of ours sets the device
// up, watches it and releases it. If the device is missing, lost or silent, that
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

#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/device/openhaptics/hd_library.h"
#include "server/device/openhaptics/hd_servo.h"
#include "server/device/stream/device_link.h"

namespace palpate {

// The link of the HD library: a thread that sets its devices up, watches their frames, and releases
// the devices in this order: zero force, scheduler, callback, devices.
//
// The library has one scheduler for all devices. Whether a device may be set up while it runs is
// not known. So a device that is missing or lost is left out, and all are set up again once the
// forces of the others have been off for kRetryBeside.
//
// Threads: Start and Stop on the main thread, all other functions on any ordinary thread. Of the
// library's functions, those outside of frames are called on the link's thread alone.
// Not real-time.
// Errors: Error if the library is missing.
class HdControl : public std::enable_shared_from_this<HdControl> {
 public:
  // How long the forces of the others must have been off. Without others: DeviceLink::kRetry.
  static constexpr std::chrono::milliseconds kRetryBeside{5000};

  // device_names: as in the vendor's set-up; "": its default device. max_force_n: the spec's limit.
  // If the library states a lower limit, that limit applies.
  HdControl(const std::string& library_path, const std::vector<std::string>& device_names,
            double max_force_n);

  void Start();
  // Returns false if the library does not let go in time. The thread then keeps this object.
  bool Stop(std::chrono::milliseconds longest) noexcept;

  HdServo& device(std::size_t n) { return devices_[n]->servo; }
  DeviceHealth health(std::size_t n) const;
  void Calibrate(std::size_t n);

 private:
  using Clock = std::chrono::steady_clock;

  struct Device {
    Device(const hd::Functions& functions, std::string its_name)
        : name(std::move(its_name)),
          servo(functions, name.empty() ? "openhaptics" : "openhaptics " + name) {}

    const std::string name;
    HdServo servo;
    // The link's thread's.
    bool is_set_up = false;
    bool is_alive = false;
    int silent_polls = 0;
    std::uint64_t calibrations = 0;
    std::string identity{};
    std::string last_error{};
    std::map<unsigned int, Clock::time_point> told{};  // when each error code was last reported
    std::atomic<hd::Enum> calibration_style{0};
  };

  std::chrono::milliseconds Connect();
  void SetUp(Device& device);
  HdConnection Identify(hd::Handle handle, std::string& identity);
  // Returns false if the library refuses.
  bool StartFrames();
  void Stream();
  void TearDown();
  void Watch(Device& device);
  void TakeErrors(Device& device);
  bool ShallSetUpAgain() const;
  void Fail(Device& device, const std::string& problem);

  // Queries to the library.
  hd::ErrorInfo NewestError();
  double GetDouble(hd::Enum name, double otherwise);
  std::string GetText(hd::Enum name);

  HdLibrary library_;
  const hd::Functions& hd_;
  const double max_force_n_;
  HdLoop loop_;
  std::vector<std::unique_ptr<Device>> devices_;
  std::optional<hd::SchedulerHandle> callback_{};  // the link's thread's
  Clock::time_point pushed_at_{};                  // the newest time when motors were on
  DeviceLink link_;
};

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
