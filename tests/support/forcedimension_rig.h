// A device of Force Dimension over a library of our own, in this process, and the hand that holds
// it.
#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/device/forcedimension/forcedimension_bus.h"
#include "tests/support/fake_drd.h"
#include "tests/support/places.h"
#include "tests/support/served_device.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/vendor_hands.h"

namespace palpate::test {
namespace forcedimension {

inline const Wrench kPush{.force_n = Vec3(0.5, -0.25, 1.0), .torque_n_mm = Vec3(10, 20, 30)};
inline constexpr const char* kSigma = "sigma.7";

// A sigma.7, the model that has all, unless the test says otherwise.
class ForceDimensionTest : public ::testing::Test {
 protected:
  ForceDimensionTest() {
    fake().watchdog_slack_ms = 60'000;  // this machine may stop for long
    Be(kSigma, true, true, true);
  }
  ~ForceDimensionTest() override {
    device_.reset();
    EXPECT_EQ(drd_.Breaches(), breaches_);
    EXPECT_EQ(fake().gripper_force, 0.0);
  }

  FakeDrdDevice& fake(int n = 0) { return drd_.device(n); }
  void Be(const char* name, bool has_wrist, bool has_torque, bool has_gripper) {
    std::snprintf(fake().system_name, sizeof fake().system_name, "%s", name);
    fake().has_wrist = has_wrist;
    fake().has_active_wrist = has_torque;
    fake().has_gripper = has_gripper;
  }
  void Make(ForceDimensionOptions options = {.model = kSigma}) {
    if (options.library == FdLibrary::kDefaultPath) options.library = kFakeDrd;
    device_.reset();
    device_ = std::make_unique<ServedDevice>(std::make_unique<ForceDimensionBus>(options));
  }
  Vec3 Felt_M_n() { return hand_.Felt_n(); }
  bool Feels(const Wrench& wrench_M) {
    return (hand_.Felt_n() - wrench_M.force_n).norm() < 1e-9 &&
           (hand_.FeltTorque_n_mm() - wrench_M.torque_n_mm).norm() < 1e-9;
  }
  bool Pushes() {
    return device_->Serve(kPush, [&] { return Feels(kPush); });
  }
  bool PushesSoon() { return device_->Streams() && Pushes(); }
  // Its last command was none, and its motors are off.
  bool IsLetGoOf() {
    return !fake().forces_enabled && fake().force[0] == 0.0 && fake().force[1] == 0.0 &&
           fake().force[2] == 0.0 && fake().torque[0] == 0.0 && fake().torque[1] == 0.0 &&
           fake().torque[2] == 0.0;
  }
  // The device is lost, says why, is let go of, and pushes again once it is well. `hears`: it can
  // be told a zero.
  void ExpectLost(const std::string& line, const std::function<void()>& mend, bool hears = true) {
    EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kFault; }));
    EXPECT_TRUE(Eventually([&] { return hears ? IsLetGoOf() : Feels({}); })) << line;
    EXPECT_TRUE(device_->Logs(line)) << line << "; " << device_->log();
    mend();
    EXPECT_TRUE(Pushes()) << line;
    device_->Forget();
  }

  TemporaryFolder folder_;
  FakeDrd drd_{folder_.path()};
  ForceDimensionHand hand_{drd_.device()};
  std::unique_ptr<ServedDevice> device_;
  std::vector<std::string> breaches_{};  // expected of the test
};

}  // namespace forcedimension
}  // namespace palpate::test
