// A device over an HD library of our own, in this process, and the hand that holds it. The fake
// starts anew with each rig: one at a time.
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/device/openhaptics/openhaptics_device.h"
#include "tests/support/fake_hd.h"
#include "tests/support/places.h"
#include "tests/support/served_device.h"

namespace palpate::test {

class OpenHapticsRig : public DeviceRig {
 public:
  static constexpr unsigned int kCommError = 0x0302;
  static constexpr const char *kKind = "openhaptics", *kOwn = "", *kOther = "Right";
  static constexpr const char* kBoth = nullptr;  // the library has a default device
  static constexpr const char *kAbsent = "cannot set up the device", *kLost = "is lost";
  static constexpr const char* kSilent = "stands still";
  static constexpr std::size_t kLinesOfALoss = 2;

  OpenHapticsRig() {
    void* library = dlopen(kFakeHd, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    EXPECT_NE(library, nullptr) << dlerror();
    hd_ = reinterpret_cast<FakeHd::Instance>(dlsym(library, FakeHd::kInstance))();
    Set([](FakeHdRecord& hd) { hd = {}; });
  }
  ~OpenHapticsRig() {
    device_.reset();
    EXPECT_EQ(Get(&FakeHd::breaches), std::vector<std::string>{});
  }

  void Set(const std::function<void(FakeHdRecord&)>& change) {
    const std::lock_guard lock(hd_->mutex);
    change(*hd_);
  }
  template <class Value>
  Value Get(Value FakeHdRecord::*member) {
    const std::lock_guard lock(hd_->mutex);
    return hd_->*member;
  }

  // The device's name in the vendor's set-up stands for a serial number.
  void Make(const std::string& name = "") {
    device_.reset();
    name_ = name;
    device_ = std::make_unique<ServedDevice>(std::make_unique<OpenHapticsDevice>(
        OpenHapticsOptions{.library = kFakeHd, .device_name = name}));
  }
  void Plug() {
    Set([](FakeHdRecord& hd) { hd.init_error = hd.unplugged_error = 0; });
  }
  void Unplug() {
    Set([](FakeHdRecord& hd) { hd.init_error = hd.unplugged_error = kCommError; });
  }
  void PlugOther() {}
  void SetSilent(bool silent) {
    Set([=](FakeHdRecord& hd) { hd.stands_still = silent; });
  }
  void Place(const Vec3& p_mm) {
    Set([&](FakeHdRecord& hd) { hd.position = {p_mm.x(), p_mm.y(), p_mm.z()}; });
  }
  Vec3 Felt_n() { return Vec3(Get(&FakeHd::force).data()); }
  bool IsLetGoOf() { return Feels(Vec3::Zero()) && !Get(&FakeHd::devices)[name_].motors_on; }
  DeviceTally Tally() {
    const std::lock_guard lock(hd_->mutex);
    return {.readings = hd_->frames, .forces = hd_->forces_set, .pushes = hd_->pushes};
  }
  std::uint64_t Touches() { return Get(&FakeHd::frames); }
  bool IsTouched() { return Get(&FakeHd::devices).contains(""); }
  bool IsOtherDriven() { return Get(&FakeHd::devices)[kOther].frames > 0; }
  std::vector<Hindrance> Hindrances() {
    return {{.make = [this] { Unplug(), Make(); },
             .undo = [this] { Plug(); },
             .told = {"HD_COMM_ERROR"}},
            {.make = [this] { Set([](auto& hd) { hd.start_error = 0x0304; }), Make(); },
             .undo = [this] { Set([](auto& hd) { hd.start_error = 0; }); },
             .told = {"HD_TIMER_ERROR"}}};
  }
  bool Feels(const Vec3& force_n) { return (Felt_n() - force_n).norm() < kForceN; }
  bool Pushes() {
    return device_->Serve(kPush, [&] { return Feels(kPush.force_n); });
  }

  FakeHd* hd_ = nullptr;

 private:
  std::string name_{};
};

}  // namespace palpate::test
