// Force Dimension's devices over a library of our own, in this process: set-up, and each fault.
// forcedimension_calibration_test.cpp has what keeps them from forces; device_daemon_test.cpp has
// the whole daemon, killed and frozen. What a real device does is not shown here.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "tests/support/forcedimension_rig.h"
#include "tests/support/refusal.h"

namespace palpate::test {
namespace forcedimension {

TEST_F(ForceDimensionTest, IsSetUpWithItsWatchdogAndLetGoOfBraked) {
  struct sigaction before {
  }, after{};
  sigaction(SIGINT, nullptr, &before);
  Make();
  ASSERT_TRUE(device_->Streams());
  sigaction(SIGINT, nullptr, &after);
  EXPECT_EQ(before.sa_handler, after.sa_handler);
  EXPECT_EQ(fake().watchdog_steps, 160);  // 20 ms
  EXPECT_TRUE(fake().brakes_on);
  EXPECT_EQ(fake().gravity_sets, 1);
  EXPECT_TRUE(fake().gravity_compensation);
  EXPECT_EQ(fake().max_force, 12.0);
  EXPECT_EQ(fake().max_torque, 0.2);
  EXPECT_EQ(fake().max_gripper_force, 0.0);
  EXPECT_EQ(fake().enable_offs, 1);  // whatever a program before left on
  EXPECT_FALSE(drd_.record().expert_mode);
  EXPECT_EQ(fake().enable_ons, 0);
  EXPECT_TRUE(device_->Logs("brakes 20 ms after the last command"));
  for (const char* part : {"sigma.7", "12345", "firmware 3.1", "SDK 3.17.5", "compensation on"}) {
    EXPECT_NE(device_->health().identity.find(part), std::string::npos) << part;
  }
  EXPECT_TRUE(Pushes());
  (*device_)->Stop();
  EXPECT_TRUE(IsLetGoOf());
  EXPECT_FALSE(fake().opened);
}

// As an Omni's stylus: -z is where the handle points, x is right, y is up.
TEST_F(ForceDimensionTest, TheHandleTurnsAsAStylusAndTorqueTurnsItBack) {
  Make();
  ASSERT_TRUE(device_->Streams());
  const Vec3 vendors_right(0, 1, 0), vendors_up(0, 0, 1), away(-1, 0, 0);
  const struct {
    Vec3 axis, points_M, up_M;
  } turns[] = {{Vec3::Zero(), -Vec3::UnitZ(), Vec3::UnitY()},
               {-vendors_up, Vec3::UnitX(), Vec3::UnitY()},       // to the user's right
               {-vendors_right, -Vec3::UnitY(), -Vec3::UnitZ()},  // down
               {away, -Vec3::UnitZ(), Vec3::UnitX()}};            // rolled clockwise
  for (const auto& turn : turns) {
    hand_.Turn(turn.axis.isZero() ? 0.0 : M_PI / 2, turn.axis);
    EXPECT_TRUE(device_->Serve(Wrench{}, [&] {
      const Eigen::Quaterniond& R_MS = device_->state().R_MS;
      return (R_MS * -Vec3::UnitZ() - turn.points_M).norm() < 1e-9 &&
             (R_MS * Vec3::UnitY() - turn.up_M).norm() < 1e-9;
    })) << turn.axis.transpose();
  }
}

TEST_F(ForceDimensionTest, ASilentServoEndsTheTorque) {
  Make();
  ASSERT_TRUE(PushesSoon());
  EXPECT_TRUE(Eventually([&] { return IsLetGoOf(); }));
}

TEST_F(ForceDimensionTest, TheMiddleOfASigmaIsBesideItsHand) {
  fake().position[0] = -0.01;
  for (const bool is_left : {true, false}) {
    fake().left_handed = is_left;
    fake().position[1] = is_left ? -0.02 : 0.02;
    Make();
    ASSERT_TRUE(device_->Streams());
    ASSERT_TRUE(device_->ServeUntil(DeviceStatus::kOk));
    EXPECT_LT(device_->state().p_MHip_mm.norm(), 1e-9);
  }
}

TEST_F(ForceDimensionTest, WhatNoModelHasIsRefused) {
  using palpate::testing::Refusal;
  EXPECT_EQ(Refusal([&] { Make({.model = "omega"}); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(Refusal([&] { Make({.model = "omega.3", .gripper_button = true}); }),
            ErrorKind::kInvalidArgument);
}

TEST_F(ForceDimensionTest, WhatTheKernelKnowsOfADeviceThatIsNotFound) {
  const auto put = [&](const std::string& path, const std::string& text) {
    std::filesystem::create_directories((folder_.path() / path).parent_path());
    std::ofstream(folder_.path() / path) << text << "\n";
  };
  EXPECT_EQ(FindFdOnUsb(folder_.path()).count, 0);
  put("sys/bus/usb/devices/1-1/idVendor", "0403");
  EXPECT_EQ(FindFdOnUsb(folder_.path()).count, 0);
  put("sys/bus/usb/devices/1-2/idVendor", "1451");
  put("sys/bus/usb/devices/1-2/busnum", "1");
  put("sys/bus/usb/devices/1-2/devnum", "7");
  EXPECT_EQ(FindFdOnUsb(folder_.path()).count, 1);
  EXPECT_FALSE(FindFdOnUsb(folder_.path()).may_open);
  put("dev/bus/usb/001/007", "");
  EXPECT_TRUE(FindFdOnUsb(folder_.path()).may_open);
}

TEST_F(ForceDimensionTest, AStatusOfAnyLengthIsUnderstood) {
  for (const int length : {15, 16, 17, 32}) {
    fake().status_length = length;
    Make();
    EXPECT_TRUE(PushesSoon()) << length;
  }
}

TEST_F(ForceDimensionTest, ManyFailedCallsLoseTheDeviceAndAFewDoNot) {
  Make();
  ASSERT_TRUE(PushesSoon());
  fake().fail_next_positions = 9;
  EXPECT_TRUE(device_->Serve(kPush, [&] { return fake().fail_next_positions == 0; }));
  EXPECT_TRUE(Pushes());
  EXPECT_EQ(device_->health().connections, 1u);
  EXPECT_GE(device_->health().transfer_errors, 9u);
  for (int error = 1; error <= 22; ++error) {
    fake().position_error = error;
    fake().position_result = -1;
    const std::string line = error == 5 ? "unplugged" : "error " + std::to_string(error) + ",";
    ExpectLost(line, [&] { fake().position_result = 0; });
  }
  fake().force_result = -1;
  ExpectLost(
      "ForceAndTorqueAndGripperForce fails", [&] { fake().force_result = 0; }, false);
}

// A status that cannot be read: whether it is calibrated, and whether its forces are on, nobody
// knows.
TEST_F(ForceDimensionTest, WithoutAStatusThereIsNoForce) {
  Make();
  ASSERT_TRUE(PushesSoon());
  fake().status_result = -1;
  EXPECT_TRUE(device_->Serve(kPush, [&] { return !device_->state().calibrated; }));
  EXPECT_TRUE(device_->Serve(kPush, [&] { return IsLetGoOf(); }));
  EXPECT_EQ(device_->health().connections, 1u);
  EXPECT_TRUE(device_->Logs("does not tell its state", kPush));
  EXPECT_TRUE(device_->Logs("dhdGetStatus fails", kPush));
  EXPECT_FALSE(fake().forces_enabled);
  fake().status_result = 0;
  EXPECT_TRUE(Pushes());
}

TEST_F(ForceDimensionTest, MotorsThatDoNotGoOffAreAFaultAndAreTold) {
  breaches_ = {"drdClose with forces enabled"};
  fake().watchdog_settable = false;
  Make({.model = kSigma, .without_watchdog = true});
  ASSERT_TRUE(PushesSoon());
  fake().off_result = fake().force_result = -1;
  EXPECT_TRUE(device_->Logs("may still push", kPush));
  fake().off_result = fake().force_result = 0;
  EXPECT_TRUE(Pushes());
  device_->Forget();
  fake().off_result = -1;
  EXPECT_TRUE(device_->Logs("do not go off", {}));
  fake().off_result = 0;
  EXPECT_TRUE(Pushes());
}

TEST_F(ForceDimensionTest, MotorsThatAreOnByThemselvesAreSwitchedOff) {
  Make();
  ASSERT_TRUE(device_->Streams());
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  // In this order: the watchdog of forces without a command would switch them off.
  fake().last_command_ns = FakeDrdNowNs();
  fake().forces_enabled = true;
  EXPECT_TRUE(Eventually([&] { return !fake().forces_enabled; }));
  EXPECT_TRUE(device_->Logs("switched off"));
}

TEST_F(ForceDimensionTest, OldStrangeAndMissingReadingsAreNone) {
  Make();
  ASSERT_TRUE(PushesSoon());
  const auto lost = [&](std::atomic<bool>& fault) {
    fault = true;
    ExpectLost("no reading for 100 ms", [&] { fault = false; });
    EXPECT_TRUE(device_->state().p_MHip_mm.allFinite());
  };
  lost(fake().gives_nan);
  lost(fake().gives_singular);
  EXPECT_GT(device_->health().corrupt_frames, 10u);
}

TEST_F(ForceDimensionTest, ACallThatBlocksMakesReadingsOld) {
  Make();
  ASSERT_TRUE(PushesSoon());
  fake().block_next_ms = 3;
  EXPECT_TRUE(device_->Serve(kPush, [&] { return fake().block_next_ms == 0; }));
  EXPECT_TRUE(Pushes());
  fake().block_next_ms = 8;
  EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kStale; }));
  EXPECT_TRUE(Pushes());
  device_->motors_on_while_stale = true;
  fake().block_next_ms = 120;  // longer than its watchdog: it has braked
  ExpectLost("no command came in time", [] {});
}

TEST_F(ForceDimensionTest, ACallThatNeverReturnsIsLeftAloneAndTheDeviceBrakes) {
  Make();
  ASSERT_TRUE(PushesSoon());
  fake().watchdog_slack_ms = 0;
  fake().block_next_ms = -1;
  EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kFault; }));
  EXPECT_TRUE(Feels({}));
  EXPECT_TRUE(fake().IsWatchdogTripped(FakeDrdNowNs()));
  (*device_)->Stop();  // returns
  EXPECT_TRUE(device_->Logs("does not end"));
  fake().block_next_ms = 0;
  EXPECT_TRUE(Eventually([&] { return !fake().opened; }));
}

// However soon its motors are switched by palpated after that.
TEST_F(ForceDimensionTest, ADeviceThatEndsItsForcesIsAFaultAndSaysWhy) {
  Make();
  ASSERT_TRUE(PushesSoon());
  const std::pair<int, std::string> causes[] = {{1, "force button was pressed"},
                                                {2, "faster"},
                                                {3, "watchdog"},
                                                {6, "no hand"},
                                                {5, "USB connection"},
                                                {4, "press its force button"}};
  for (const bool is_silent : {false, true}) {
    for (const auto& [cause, part] : causes) {
      ASSERT_TRUE(device_->Serve(kPush, [&, n = fake().forces_set + 10] {
        return fake().forces_set > n && Feels(kPush);
      }));
      fake().force_off_cause = cause;
      if (is_silent) std::this_thread::sleep_for(std::chrono::milliseconds(8));
      ExpectLost(part, [] {});
    }
  }
  fake().ignores_enable = true;  // nobody pressed its force button
  ExpectLost("press its force button", [&] { fake().ignores_enable = false; });
}

TEST_F(ForceDimensionTest, MotorsThatCannotAreWarnedOf) {
  Make();
  ASSERT_TRUE(PushesSoon());
  fake().force_result = 2;
  EXPECT_TRUE(device_->Logs("scaled down", kPush));
  EXPECT_TRUE(Pushes());
}

}  // namespace forcedimension
}  // namespace palpate::test
