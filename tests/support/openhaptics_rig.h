// An OpenHapticsDevice that uses the tests' HD library, PALPATE_FAKE_HD.
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/device/openhaptics/openhaptics_device.h"
#include "tests/support/fake_hd.h"
#include "tests/support/places.h"

namespace palpate::testing {

inline std::string ErrorOf(const std::function<void()>& act) {
  try {
    act();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

inline bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

inline bool WaitFor(const std::function<bool()>& holds) {
  for (int i = 0; i < 5000; ++i) {
    if (holds()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

// With ctest, every test runs in a process of its own. In a shared process, each test releases its
// device, and the fake starts anew except for the device.
class OpenHapticsRig : public ::testing::Test {
 protected:
  OpenHapticsRig() {
    void* library = dlopen(test::kFakeHd, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    EXPECT_NE(library, nullptr) << dlerror();
    hd_ = reinterpret_cast<FakeHd::Instance>(dlsym(library, FakeHd::kInstance))();
    const std::lock_guard lock(hd_->mutex);
    const FakeHd fresh;
    hd_->init_error = hd_->init_handle = hd_->rate_error = hd_->start_error = 0;
    hd_->unplugged_error = 0;
    hd_->errors.clear();
    hd_->error_stack.clear();
    hd_->max_force_n = fresh.max_force_n;
    hd_->calibration_style = fresh.calibration_style;
    hd_->calibration = fresh.calibration;
    hd_->init_gives_handle = hd_->hangs_in_stop = hd_->stands_still = hd_->counts_in_position =
        false;
    hd_->position = fresh.position;
    hd_->transform = fresh.transform;
    hd_->buttons = 0;
    hd_->inkwell_switch = 1;
    hd_->calls.clear();
    hd_->breaches.clear();
    hd_->frames = hd_->inits = hd_->calibration_updates = hd_->frames_with_force = 0;
  }
  ~OpenHapticsRig() override {
    device_.reset();
    const std::lock_guard lock(hd_->mutex);
    EXPECT_EQ(hd_->breaches, std::vector<std::string>{});
  }

  template <class Function>
  auto With(Function function) {
    const std::lock_guard lock(hd_->mutex);
    return function(*hd_);
  }

  void Start() {
    device_ = std::make_unique<OpenHapticsDevice>(
        OpenHapticsOptions{.library = test::kFakeHd, .device_name = ""});
    device_->Start();
  }
  void StartStreaming() {
    Start();
    ASSERT_TRUE(WaitFor([&] { return IsStreaming(); }));
  }
  bool IsStreaming() const { return device_->health().connection == DeviceConnection::kStreaming; }
  // Ticks like the servo until the condition holds. The last state is in state_.
  bool Tick(const Vec3& force_n, const std::function<bool()>& holds) {
    return WaitFor([&] {
      status_ = device_->Read(state_);
      device_->SetMotors(true);
      // The safety stage does the same after a halt of this machine.
      device_->Write(status_ == DeviceStatus::kStale ? Vec3::Zero() : force_n, 0.001);
      return holds();
    });
  }
  std::vector<std::string> Events() {
    std::vector<std::string> texts;
    while (std::optional<DeviceEvent> event = device_->NextEvent()) texts.push_back(event->text);
    return texts;
  }
  int CountEvents(const std::vector<std::string>& texts, const std::string& part) {
    return static_cast<int>(std::ranges::count_if(
        texts, [&](const std::string& text) { return Contains(text, part); }));
  }
  Vec3 Force() {
    return With([](FakeHd& hd) { return Vec3(hd.force.data()); });
  }
  std::vector<std::string> Calls() {
    return With([](FakeHd& hd) { return hd.calls; });
  }

  FakeHd* hd_ = nullptr;
  std::unique_ptr<OpenHapticsDevice> device_;
  DeviceState state_;
  DeviceStatus status_ = DeviceStatus::kFault;
};

}  // namespace palpate::testing
