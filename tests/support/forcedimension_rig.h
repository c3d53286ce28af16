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
class ForceDimensionRig : public DeviceRig {
 public:
  ForceDimensionRig() {
    fake().watchdog_slack_ms = 60'000;  // this machine may stop for long
    Be(kSigma, true, true, true);
  }
  ~ForceDimensionRig() {
    device_.reset();
    EXPECT_EQ(drd_.Breaches(), breaches_);
    EXPECT_EQ(fake().gripper_force, 0.0);
  }

  FakeDrdDevice& fake(int n = 0) { return drd_.device(n); }
  static void Name(FakeDrdDevice& device, const char* name) {
    std::snprintf(device.system_name, sizeof device.system_name, "%s", name);
  }
  void Be(const char* name, bool has_wrist, bool has_torque, bool has_gripper) {
    Name(fake(), name);
    fake().has_wrist = has_wrist;
    fake().has_active_wrist = has_torque;
    fake().has_gripper = has_gripper;
  }
  void Make(ForceDimensionOptions options = {.model = kSigma}) {
    if (options.library == FdLibrary::kDefaultPath) options.library = kFakeDrd;
    device_.reset();
    device_ = std::make_unique<ServedDevice>(std::make_unique<ForceDimensionBus>(options));
  }
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
  std::vector<std::string> breaches_{};  // expected of the test
};

class ForceDimensionTest : public ::testing::Test, protected ForceDimensionRig {};

}  // namespace forcedimension

// An omega.3, which has a force only.
class OmegaRig : public forcedimension::ForceDimensionRig {
 public:
  static constexpr const char *kKind = "forcedimension", *kModel = "omega.3";
  static constexpr const char *kOwn = "12345", *kOther = "54321", *kBoth = "12345, 54321";
  static constexpr bool kEndsItsForce = true;
  static constexpr int kRateHz = 2000;
  static constexpr double kMostLost = 10.0;
  static inline const Vec3 kBelow{0.0, -70.0, 0.0};

  OmegaRig() { Be(kModel, false, false, false); }
  ~OmegaRig() {
    device_.reset();
    EXPECT_FALSE(fake().opened || fake(1).opened);
  }

  void Make(const std::string& serial = "") {
    ForceDimensionRig::Make({.model = kModel, .serial = serial});
  }
  void Plug() { fake().present = true; }
  void Unplug() { fake().present = false; }
  void PlugOther() {
    Name(fake(1), kModel);
    fake(1).present = true;
  }
  // Too early for a reading, says the library.
  void SetSilent(bool silent) { fake().position_result = silent ? 1 : 0; }
  void Place(const Vec3& p_mm) { hand_.Place(p_mm); }
  Vec3 Felt_n() { return hand_.Felt_n(); }
  // Without a program it brakes by itself.
  bool IsLetGoOf() { return fake().present ? ForceDimensionRig::IsLetGoOf() : Felt_n().isZero(); }
  DeviceTally Tally() {
    const auto count = [](int n) { return static_cast<std::uint64_t>(n); };
    return {.readings = count(fake().positions_read),
            .forces = count(fake().forces_set),
            .pushes = count(fake().pushes)};
  }
  std::uint64_t Touches() { return static_cast<std::uint64_t>(fake().enable_ons); }
  bool IsTouched() { return fake().opened; }
  bool IsOtherDriven() { return fake(1).opened; }
  std::vector<Hindrance> Hindrances() {
    const auto without_library = [this](const std::string& library, const char* told) {
      return Hindrance{
          .make = [=, this] { ForceDimensionRig::Make({.library = library, .model = kModel}); },
          .told = {told, "forcedimension_library"},
          .comes_by_itself = false};
    };
    const auto is_another = [this](const char* name, const char* told) {
      return Hindrance{.make = [=, this] { Be(name, true, false, true), Make(); },
                       .undo = [this] { Be(kModel, false, false, false); },
                       .told = {told},
                       .comes_by_itself = false};
    };
    const auto use = [this](bool both) {
      fake().used_by_another = true;
      fake(1).present = both;
      Make();
    };
    const auto leave = [this] { fake().used_by_another = fake(1).present = false; };
    return {without_library("libdrd-not-there.so", "ldconfig"),
            without_library(kFakeDrdMissing, "dhdSetForceAndTorqueAndGripperForce"),
            without_library(kFakeDrdOld, "3.9.0"),
            {.make = [=] { use(false); }, .undo = leave, .told = {"another program"}},
            {.make = [=] { use(true); }, .undo = leave, .told = {kOther}},
            {.make = [this] { Make("777"); }, .told = {kOwn}, .comes_by_itself = false},
            is_another("omega.7", "\"omega.7\""),
            is_another("novelty", "delta.3")};
  }
  // A real daemon is braked by the device when it is late.
  std::string config() {
    fake().watchdog_slack_ms = 0;
    return "kind = \"forcedimension\"\nforcedimension_library = \"" + std::string(kFakeDrd) +
           "\"\n";
  }
  void ExpectLetGoInOrder() {
    EXPECT_TRUE(ForceDimensionRig::IsLetGoOf());
    EXPECT_EQ(fake().closes, 1);
    EXPECT_EQ(fake().force_off_cause, 0);  // its watchdog had nothing to do
  }
  bool Pushes() {
    return device_->Serve(kPush, [&] { return (Felt_n() - kPush.force_n).norm() < kForceN; });
  }
};

}  // namespace palpate::test
