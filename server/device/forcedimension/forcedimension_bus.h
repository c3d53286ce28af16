// Force Dimension's devices (delta, omega, sigma, lambda) by the vendor's library, which is loaded
// at run time.
//
// The library has no loop of its own: the I/O thread reads and writes 2000 times a second. Each
// call talks to the device and takes as long as that takes. The device's own watchdog is set to
// kWatchdogMs: when no command comes, as after a crash, the device brakes by itself. A device whose
// watchdog does not read back as set gets no force, unless an option says that it may.
//
// Motors off means braked: the arm sinks slowly. Motors on means that the library also holds the
// arm's weight (gravity compensation), which it adds to each force.
// A device that ends its forces by itself (its force button, its limit of velocity, its watchdog,
// its dead man's switch) is a fault.
//
// Frame M: its middle is that of the workspace; see fd_library.h. Torques are about that point of
// the wrist whose position is read.
// Threads, errors: as StreamBus. The library's functions are called on the I/O thread, but for what
// ends a motion of the arm: the library takes calls from any thread, say its documents. Nobody of
// us knows whether such a call waits for the motion's end. Verification level: none; we have not
// seen a device, and not run the vendor's library.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "server/device/forcedimension/fd_library.h"
#include "server/device/stream/streamed_device.h"

namespace palpate {

struct ForceDimensionOptions {
  std::string library = FdLibrary::kDefaultPath;
  std::string model = "omega.3";  // see FdModelNames
  std::string serial{};           // "": the only device
  bool gripper_button = false;    // closing the gripper is the button
  bool without_watchdog = false;  // forces also from a device that cannot brake by itself
};

// The devices of this vendor on USB, by the kernel: it is asked beside a device that streams, which
// the library is not. `root`: the folder that has sys and dev. Any thread.
struct FdOnUsb {
  int count = 0;
  bool may_open = true;  // this user may open all of them
};
FdOnUsb FindFdOnUsb(const std::filesystem::path& root = "/");

class ForceDimensionBus final : public StreamBus {
 public:
  static constexpr int kRateHz = 2000;
  static constexpr double kWatchdogMs = 20.0;

  // Throws Error (kInvalidArgument) for a model that is none, or a gripper that it does not have.
  explicit ForceDimensionBus(ForceDimensionOptions options);

  const DeviceDescription& spec() const override { return spec_; }
  std::unique_ptr<StreamSession> Open(const std::atomic<bool>& stop) override;
  std::string calibration_hint() const override { return exchange_.hint.load(); }
  // The arm then moves by itself, after a warning and kCalibrationWarning, unless StopMoving comes.
  void RequestCalibration() override;
  void StopMoving() noexcept override { ++exchange_.stops; }
  bool moves_by_itself() const noexcept override {
    return spec_.calibration_moves_arm && exchange_.calibrates;
  }

  static constexpr std::chrono::seconds kCalibrationWarning{3};

  // What any thread tells the session, and it them.
  struct Exchange {
    std::atomic<bool> calibrates{false};  // from the request to the end
    std::atomic<std::uint32_t> stops{0};  // of motions
    std::atomic<std::uint32_t> stops_at_request{0};
    bool is_stopped() const { return stops != stops_at_request; }
    std::atomic<const char*> hint{""};  // why it is not calibrated, or why it gets no force
  };

 private:
  // Opens the device, or throws BusError. Returns its ID.
  char Choose() const;
  // Opens the one with the serial number; among `others` are those of the rest.
  std::optional<char> OpenOne(int count, std::string& others, std::string& refused) const;

  const ForceDimensionOptions options_;
  const FdModel& model_;
  const DeviceDescription spec_;
  std::optional<FdLibrary> library_{};
  std::mutex requests_;  // one at a time
  Exchange exchange_;
};

}  // namespace palpate
