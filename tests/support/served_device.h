// A device that is served as the servo does: read and written about once a ms, with the safety
// stage's answer to readings that are not good.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "server/device/stream/streamed_device.h"
#include "tests/support/patience.h"

namespace palpate::test {

class ServedDevice {
 public:
  explicit ServedDevice(std::unique_ptr<StreamBus> bus)
      : device_(std::make_unique<StreamedDevice>(std::move(bus), "palpate-test", 0)) {
    device_->Start();
  }

  StreamedDevice& operator*() { return *device_; }
  StreamedDevice* operator->() { return device_.get(); }
  const DeviceState& state() const { return state_; }
  DeviceStatus status() const { return status_; }

  bool Streams() {
    return Eventually([&] { return device_->health().connection == DeviceConnection::kStreaming; });
  }
  bool HasProblem(const std::string& part) {
    return Eventually([&] { return device_->health().problem.find(part) != std::string::npos; });
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
      device_->Write({.wrench_M = may ? wrench_M(state_) : Wrench{},
                      .motors_on = status_ != DeviceStatus::kFault},
                     0.001);
      return is_so();
    });
  }
  bool Serve(const Wrench& wrench_M, const std::function<bool()>& is_so) {
    return Serve([&](const DeviceState&) { return wrench_M; }, is_so);
  }
  bool ServeUntil(DeviceStatus status) {
    return Serve(Wrench{}, [&] { return status_ == status; });
  }

 private:
  std::unique_ptr<StreamedDevice> device_;
  DeviceState state_;
  DeviceStatus status_ = DeviceStatus::kFault;
  std::string log_;
};

// A plane on each side of the middle, 1 mm away, of 0.5 N/mm: the hand goes 2 mm into it.
template <class Hand>
void ExpectPushedOutOfPlanes(ServedDevice& device, Hand& hand) {
  for (int n = 0; n < 6; ++n) {
    Vec3 into = Vec3::Zero();
    into[n / 2] = n % 2 == 0 ? 1.0 : -1.0;
    hand.Place(3.0 * into);
    const auto plane = [&](const DeviceState& state) {
      const double depth_mm = state.p_MHip_mm.dot(into) - 1.0;
      return Wrench{.force_n = -0.5 * std::max(depth_mm, 0.0) * into};
    };
    EXPECT_TRUE(device.Serve(plane, [&] { return (hand.Felt_n() + into).norm() < 1e-3; }))
        << into.transpose() << ", felt " << hand.Felt_n().transpose();
  }
}

}  // namespace palpate::test
