// A device that is served as the servo does: read and written about once a ms, with the safety
// stage's answer to readings that are not good.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "server/device/stream/streamed_device.h"
#include "tests/support/patience.h"

namespace palpate::test {

// What a hand is pushed with.
inline const Wrench kPush{.force_n = Vec3(0.5, -0.25, 1.0)};

class ServedDevice {
 public:
  explicit ServedDevice(std::unique_ptr<HapticDevice> device) : device_(std::move(device)) {
    device_->Start();
  }
  explicit ServedDevice(std::unique_ptr<StreamBus> bus)
      : ServedDevice(std::make_unique<StreamedDevice>(std::move(bus), "palpate-test", 0)) {}

  HapticDevice& operator*() { return *device_; }
  HapticDevice* operator->() { return device_.get(); }
  DeviceHealth health() const { return device_->health(); }
  const DeviceState& state() const { return state_; }
  DeviceStatus status() const { return status_; }

  bool Streams() {
    return Eventually([&] { return health().connection == DeviceConnection::kStreaming; });
  }
  bool HasProblem(const std::string& part) {
    return Eventually([&] { return health().problem.find(part) != std::string::npos; });
  }
  bool HasLogged(const std::string& part) {
    while (const std::optional<DeviceEvent> event = device_->NextEvent()) {
      log_ += event->text + "\n";
    }
    return log_.find(part) != std::string::npos;
  }
  // Whether a line of the log gets this part; without or with service.
  bool Logs(const std::string& part) {
    return Eventually([&] { return HasLogged(part); });
  }
  bool Logs(const std::string& part, const Wrench& wrench_M) {
    return Serve(wrench_M, [&] { return HasLogged(part); });
  }
  const std::string& log() const { return log_; }
  // Of the log so far, the lines with this part.
  std::size_t CountLines(const std::string& part) {
    HasLogged(part);
    std::istringstream lines(log_);
    std::size_t count = 0;
    for (std::string line; std::getline(lines, line);) count += line.find(part) != line.npos;
    return count;
  }
  // What was logged so far counts no more.
  void Forget() {
    while (device_->NextEvent()) {
    }
    log_.clear();
  }

  // Serves until it is so. Forces are enabled.
  bool Serve(const std::function<Wrench(const DeviceState&)>& wrench_M,
             const std::function<bool()>& is_so) {
    return Eventually([&] {
      status_ = device_->Read(state_);
      const bool may = status_ == DeviceStatus::kOk && state_.calibrated;
      const bool on = may || (motors_on_while_stale && status_ == DeviceStatus::kStale);
      device_->Write({.wrench_M = may ? wrench_M(state_) : Wrench{}, .motors_on = on}, 0.001);
      return is_so();
    });
  }
  bool Serve(const Wrench& wrench_M, const std::function<bool()>& is_so) {
    return Serve([&](const DeviceState&) { return wrench_M; }, is_so);
  }
  bool ServeUntil(DeviceStatus status) {
    return Serve(Wrench{}, [&] { return status_ == status; });
  }

  bool motors_on_while_stale = false;  // as while the safety stage lowers a force

 private:
  std::unique_ptr<HapticDevice> device_;
  DeviceState state_;
  DeviceStatus status_ = DeviceStatus::kFault;
  std::string log_;
};

// What a device has counted so far. Pushes: forces that are not zero. Lost: readings that the host
// did not take.
struct DeviceTally {
  std::uint64_t readings = 0, forces = 0, pushes = 0, lost = 0;
};

// What a rig of a kind has if it says nothing else. A rig has an emulated device, the hand that
// holds it, and, once Make was called, a device of palpated's in this process.
class DeviceRig {
 public:
  // Parts of what is told of a device that is not there, that was pulled out, that sends nothing.
  static constexpr const char *kAbsent = "plug it in", *kLost = "unplugged";
  static constexpr const char* kSilent = "no reading for 100 ms";
  static constexpr std::size_t kLinesOfALoss = 1;
  static constexpr bool kForgetsItsPlace = false;  // when it is pulled out
  static constexpr bool kEndsItsForce = false;     // when palpated is killed
  static constexpr int kRateHz = 1000;
  static constexpr double kMostLost = 0.0;                  // of a second's readings
  static constexpr double kPlaceMm = 1e-6, kForceN = 1e-3;  // how exactly it is read and pushed
  static inline const Vec3 kRest = Vec3::Zero();
  static inline const Vec3 kBelow{0.0, -47.0, 0.0};  // palpated's sphere

  // What is put before palpated's command.
  std::vector<std::string> wrapper() const { return {}; }
  void Dock() {}

  std::unique_ptr<ServedDevice> device_;
};

// For typed tests.
struct RigNames {
  template <class Rig>
  static std::string GetName(int) {
    std::string name = Rig::kKind;
    std::ranges::replace(name, '-', '_');
    return name;
  }
};

// What keeps palpated from a device: how to make it so, and how to undo that.
struct Hindrance {
  std::function<void()> make;  // with a new device
  std::function<void()> undo = [] {};
  std::vector<std::string> told{};  // parts of the problem that the device has
  bool comes_by_itself = true;      // once it is undone
};

}  // namespace palpate::test
