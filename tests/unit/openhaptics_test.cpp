// The device over a library of our own: its order of calls, its forces and its
// troubles. What a real device does is not shown here.
#include <gtest/gtest.h>

#include <chrono>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "server/device/openhaptics/hd_errors.h"
#include "server/device/openhaptics/hd_servo.h"
#include "server/device/openhaptics/openhaptics_device.h"
#include "tests/support/fake_hd.h"
#include "tests/support/openhaptics_rig.h"
#include "tests/support/places.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;
using testing::Contains;
using testing::ErrorOf;
using testing::OpenHapticsRig;
using testing::WaitFor;
using Clock = std::chrono::steady_clock;

constexpr unsigned int kCommError = 0x0302;

class OpenHapticsTest : public OpenHapticsRig {};

TEST_F(OpenHapticsTest, AMissingLibraryIsSaidWithWhatToDo) {
  OpenHapticsDevice device({.library = "libHD-not-there.so", .device_name = ""});
  const std::string error = ErrorOf([&] { device.Start(); });
  EXPECT_TRUE(Contains(error, "libHD-not-there.so")) << error;
  EXPECT_TRUE(Contains(error, "[device] openhaptics_library")) << error;
  device.Stop();
  EXPECT_EQ(device.health().connection, DeviceConnection::kAbsent);
}

TEST_F(OpenHapticsTest, AMissingFunctionIsNamed) {
  OpenHapticsDevice device({.library = test::kFakeHdMissing, .device_name = ""});
  const std::string error = ErrorOf([&] { device.Start(); });
  EXPECT_TRUE(Contains(error, "hdScheduleAsynchronous")) << error;
}

TEST_F(OpenHapticsTest, ADeviceThatWasNeverStartedIsAtFault) {
  OpenHapticsDevice device({.library = test::kFakeHd, .device_name = ""});
  EXPECT_EQ(device.Read(state_), DeviceStatus::kFault);
  device.Write(Vec3(1, 0, 0), 0.001);
  device.Stop();
  device.Stop();
  EXPECT_FALSE(device.NextEvent().has_value());
  EXPECT_TRUE(Contains(ErrorOf([&] { device.Calibrate(); }), "not started"));
  EXPECT_TRUE(Calls().empty());
  EXPECT_EQ(device.spec().kind, "openhaptics");
  EXPECT_EQ(device.spec().verification_level, VerificationLevel::kNone);
  EXPECT_TRUE(IsHardware(device.spec()));
}

TEST_F(OpenHapticsTest, StartTwiceIsRefused) {
  StartStreaming();
  EXPECT_TRUE(Contains(ErrorOf([&] { device_->Start(); }), "already"));
  EXPECT_TRUE(IsStreaming());
}

TEST_F(OpenHapticsTest, AThousandFramesCarryPosesInAndForcesOut) {
  With([](FakeHd& hd) {
    hd.counts_in_position = true;
    hd.buttons = 2;
    return 0;
  });
  StartStreaming();
  double last_mm = 0.0;
  int ok = 0;
  int reads = 0;
  ASSERT_TRUE(Tick(Vec3(0.5, -0.25, 1.0), [&] {
    ++reads;
    ok += status_ == DeviceStatus::kOk ? 1 : 0;
    EXPECT_EQ(state_.p_DHip_mm.x(), state_.p_DHip_mm.y());
    EXPECT_EQ(state_.p_DHip_mm.x(), state_.p_DHip_mm.z());
    EXPECT_GE(state_.p_DHip_mm.x(), last_mm);
    last_mm = state_.p_DHip_mm.x();
    return device_->health().readings >= 1000;
  }));
  EXPECT_GT(ok, reads / 2);
  EXPECT_EQ(state_.buttons, 2u);
  EXPECT_FALSE(state_.docked);
  EXPECT_TRUE(state_.calibrated);
  EXPECT_GE(With([](FakeHd& hd) { return hd.frames_with_force; }), 500u);
  const DeviceHealth health = device_->health();
  EXPECT_EQ(health.identity, "Fake Touch, serial number 12345, firmware 1.25");
  EXPECT_EQ(health.problem, "");
  EXPECT_EQ(health.connections, 1u);
  EXPECT_EQ(health.corrupt_frames, 0u);
  EXPECT_EQ(health.transfer_errors, 0u);
  EXPECT_EQ(With([](FakeHd& hd) { return hd.device_name; }), "");
}

TEST_F(OpenHapticsTest, TheForceKeepsItsDirectionAndTheLowerOfTheLimits) {
  With([](FakeHd& hd) { return hd.max_force_n = 2.0; });
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(0.5, -0.25, 1.0), [&] { return Force() == Vec3(0.5, -0.25, 1.0); }));
  const Vec3 too_much(30.0, -40.0, 0.0);
  ASSERT_TRUE(Tick(too_much, [&] { return Force().isApprox(Vec3(1.2, -1.6, 0.0)); }));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(Tick(Vec3(kNan, 1.0, 0.0), [&] { return Force().isZero(0.0); }));
  EXPECT_EQ(device_->spec().max_force_n, 3.3);
}

TEST_F(OpenHapticsTest, ALimitAboveTheDatasheetsOrNoneDoesNotRaiseIt) {
  With([](FakeHd& hd) { return hd.max_force_n = std::numeric_limits<double>::infinity(); });
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(0, 100, 0), [&] { return Force().isApprox(Vec3(0, 3.3, 0)); }));
  device_->Stop();
  With([](FakeHd& hd) { return hd.max_force_n = 8.5; });
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(0, 100, 0), [&] { return Force().isApprox(Vec3(0, 3.3, 0)); }));
}

// A quarter turn about y, by columns: x goes to -z, z to x. By rows it is its inverse.
TEST_F(OpenHapticsTest, TheColumnsOfTheTransformAreTheStylussAxes) {
  With([](FakeHd& hd) {
    hd.transform = {0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 10, 20, 30, 1};
    hd.position = {10, 20, 30};
    return 0;
  });
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  EXPECT_TRUE((state_.R_DS * Vec3::UnitX()).isApprox(-Vec3::UnitZ(), 1e-9));
  EXPECT_TRUE((state_.R_DS * Vec3::UnitZ()).isApprox(Vec3::UnitX(), 1e-9));
  EXPECT_EQ(state_.p_DHip_mm, Vec3(10, 20, 30));
}

TEST_F(OpenHapticsTest, WhatIsNoPoseIsDroppedAndTheLastOneGrowsStale) {
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  With([](FakeHd& hd) { return hd.position[1] = std::numeric_limits<double>::quiet_NaN(); });
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kStale; }));
  EXPECT_EQ(state_.p_DHip_mm, Vec3(1, 2, 3));
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kFault; }));
  EXPECT_GT(device_->health().corrupt_frames, 3u);
  With([](FakeHd& hd) { return hd.position[1] = 5.0; });
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  for (const auto& bad :
       {std::array<double, 16>{},
        std::array<double, 16>{2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1},
        std::array<double, 16>{-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}) {
    With([&](FakeHd& hd) { return hd.transform = bad; });
    EXPECT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kFault; }));
    With([](FakeHd& hd) { return hd.transform = FakeHd().transform; });
    EXPECT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  }
}

TEST_F(OpenHapticsTest, AServoThatDoesNotTickLeavesNoForce) {
  StartStreaming();
  EXPECT_EQ(device_->health().watchdog_zeros, 0u);
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
  EXPECT_TRUE(WaitFor([&] { return Force().isZero(0.0); }));
  EXPECT_TRUE(WaitFor([&] { return device_->health().watchdog_zeros > 10; }));
  EXPECT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
}

TEST_F(OpenHapticsTest, ADeviceThatIsNotThereIsLookedForAgain) {
  With([](FakeHd& hd) { return hd.init_error = kCommError; });
  Start();
  ASSERT_TRUE(WaitFor([&] { return With([](FakeHd& hd) { return hd.inits; }) >= 3; }));
  EXPECT_EQ(device_->Read(state_), DeviceStatus::kFault);
  const DeviceHealth health = device_->health();
  EXPECT_EQ(health.connection, DeviceConnection::kAbsent);
  EXPECT_TRUE(Contains(health.problem, "HD_COMM_ERROR (0x302, internal 7)")) << health.problem;
  EXPECT_EQ(CountEvents(Events(), "HD_COMM_ERROR"), 1);
  With([](FakeHd& hd) { return hd.init_error = 0; });
  ASSERT_TRUE(WaitFor([&] { return IsStreaming(); }));
  EXPECT_EQ(device_->health().problem, "");
}

TEST_F(OpenHapticsTest, ADeviceThatComesWithAnErrorIsLetGoOf) {
  With([](FakeHd& hd) {
    hd.init_error = 0x0301;
    hd.init_gives_handle = true;
    return 0;
  });
  Start();
  ASSERT_TRUE(WaitFor([&] { return !device_->health().problem.empty(); }));
  EXPECT_EQ(Calls(), (std::vector<std::string>{"hdInitDevice", "hdDisableDevice"}));
}

TEST_F(OpenHapticsTest, AGarbageHandleIsNoDevice) {
  With([](FakeHd& hd) { return hd.init_handle = 0xdeadbeef; });
  Start();
  ASSERT_TRUE(WaitFor([&] { return !device_->health().problem.empty(); }));
  EXPECT_EQ(Calls(), std::vector<std::string>{"hdInitDevice"});
}

TEST_F(OpenHapticsTest, ALoopThatDoesNotStartIsTakenDownAndTriedAgain) {
  With([](FakeHd& hd) { return hd.start_error = 0x0304; });
  Start();
  ASSERT_TRUE(WaitFor([&] { return Contains(device_->health().problem, "HD_TIMER_ERROR"); }));
  ASSERT_TRUE(WaitFor([&] { return Calls().size() >= 8 && Calls().back() == "hdDisableDevice"; }));
  With([](FakeHd& hd) { return hd.start_error = 0; });
  ASSERT_TRUE(WaitFor([&] { return IsStreaming(); }));
}

TEST_F(OpenHapticsTest, ARateThatIsRefusedIsNoMatter) {
  With([](FakeHd& hd) { return hd.rate_error = 0x0101; });
  StartStreaming();
  EXPECT_EQ(CountEvents(Events(), "its own rate"), 1);
}

TEST_F(OpenHapticsTest, APluggedOutDeviceIsAFaultAndComesBack) {
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
  With([](FakeHd& hd) { return hd.init_error = hd.unplugged_error = kCommError; });
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return status_ == DeviceStatus::kFault; }));
  ASSERT_TRUE(Tick(Vec3(1, 0, 0),
                   [&] { return device_->health().connection == DeviceConnection::kAbsent; }));
  EXPECT_TRUE(Force().isZero(0.0));
  EXPECT_GE(CountEvents(Events(), "lost"), 1);
  EXPECT_GE(device_->health().transfer_errors, 10u);
  With([](FakeHd& hd) { return hd.init_error = hd.unplugged_error = 0; });
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] {
    return status_ == DeviceStatus::kOk && Force() == Vec3(1, 0, 0) && IsStreaming();
  }));
  EXPECT_EQ(device_->health().connections, 2u);
}

TEST_F(OpenHapticsTest, OneBadFrameIsNoLoss) {
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  With([](FakeHd& hd) {
    hd.errors = {kCommError};
    return 0;
  });
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return device_->health().transfer_errors == 1; }));
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return device_->health().readings > 100; }));
  EXPECT_EQ(device_->health().connections, 1u);
  EXPECT_TRUE(IsStreaming());
}

TEST_F(OpenHapticsTest, WarmMotorsAreAWarningAndNoFault) {
  StartStreaming();
  for (int i = 0; i < 5; ++i) {
    With([](FakeHd& hd) {
      hd.errors = {0x0200};
      return 0;
    });
    ASSERT_TRUE(
        Tick(Vec3(1, 0, 0), [&] { return With([](FakeHd& hd) { return hd.errors.empty(); }); }));
  }
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
  std::vector<std::string> all;
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] {
    for (std::string& text : Events()) all.push_back(std::move(text));
    return CountEvents(all, "HD_WARM_MOTORS") == 1;
  }));
  EXPECT_TRUE(IsStreaming());
  EXPECT_EQ(device_->health().transfer_errors, 0u);
}

TEST_F(OpenHapticsTest, AForceErrorTakesTheForceAwayForAWhile) {
  for (const unsigned int code : {0x0201u, 0x0202u, 0x0203u, 0x0204u}) {
    EXPECT_EQ(hd::EffectOf(code), hd::ErrorEffect::kForce);
  }
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
  const Clock::time_point begin = Clock::now();
  With([](FakeHd& hd) {
    hd.errors = {0x0203};
    return 0;
  });
  ASSERT_TRUE(
      Tick(Vec3(1, 0, 0), [&] { return Force().isZero(0.0) && status_ == DeviceStatus::kFault; }));
  ASSERT_TRUE(Tick(Vec3(1, 0, 0),
                   [&] { return Force() == Vec3(1, 0, 0) && status_ == DeviceStatus::kOk; }));
  EXPECT_GE(Clock::now() - begin, milliseconds(HdServo::kForceErrorMs));
  EXPECT_EQ(device_->health().connections, 1u);
}

TEST_F(OpenHapticsTest, AStackOfErrorsWithoutEndDoesNotHoldAFrame) {
  StartStreaming();
  With([](FakeHd& hd) {
    hd.errors.assign(10000, 0x0100);
    return 0;
  });
  const std::uint64_t before = With([](FakeHd& hd) { return hd.frames; });
  ASSERT_TRUE(WaitFor([&] { return With([](FakeHd& hd) { return hd.frames; }) > before + 200; }));
  EXPECT_TRUE(IsStreaming());
  EXPECT_LE(CountEvents(Events(), "HD_INVALID_ENUM"), 1);
}

TEST_F(OpenHapticsTest, ALoopThatStandsStillIsGivenUpAndStartedAgain) {
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return status_ == DeviceStatus::kOk; }));
  With([](FakeHd& hd) { return hd.stands_still = true; });
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return status_ == DeviceStatus::kStale; }));
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return status_ == DeviceStatus::kFault; }));
  ASSERT_TRUE(WaitFor([&] { return Contains(device_->health().problem, "stands still"); }));
  With([](FakeHd& hd) { return hd.stands_still = false; });
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] {
    return status_ == DeviceStatus::kOk && device_->health().connections >= 2;
  }));
}

TEST_F(OpenHapticsTest, TheInkwellSwitchReadsZeroInside) {
  StartStreaming();
  With([](FakeHd& hd) { return hd.inkwell_switch = 0; });
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return state_.docked; }));
  EXPECT_TRUE(device_->health().docked);
  With([](FakeHd& hd) { return hd.inkwell_switch = 1; });
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return !state_.docked; }));
}

TEST_F(OpenHapticsTest, ADeviceWithoutAnInkwellIsNeverDocked) {
  With([](FakeHd& hd) {
    hd.calibration_style = 1;
    hd.inkwell_switch = 0;
    return 0;
  });
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  EXPECT_FALSE(state_.docked);
}

TEST_F(OpenHapticsTest, TheInkwellCalibratesByItselfWhenTheLibrarySaysSo) {
  With([](FakeHd& hd) { return hd.calibration = 0x5002; });
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return status_ == DeviceStatus::kOk; }));
  EXPECT_FALSE(state_.calibrated);
  EXPECT_FALSE(device_->health().calibrated);
  EXPECT_TRUE(Contains(device_->health().problem, "inkwell"));
  EXPECT_EQ(With([](FakeHd& hd) { return hd.calibration_updates; }), 0u);
  With([](FakeHd& hd) { return hd.calibration = 0x5001; });
  ASSERT_TRUE(Tick(Vec3::Zero(), [&] { return state_.calibrated; }));
  EXPECT_EQ(With([](FakeHd& hd) { return hd.calibration_updates; }), 1u);
  EXPECT_EQ(device_->health().problem, "");
}

TEST_F(OpenHapticsTest, CalibrateWaitsForTheInkwell) {
  StartStreaming();
  device_->Calibrate();
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_EQ(With([](FakeHd& hd) { return hd.calibration_updates; }), 0u);
  With([](FakeHd& hd) { return hd.inkwell_switch = 0; });
  ASSERT_TRUE(
      WaitFor([&] { return With([](FakeHd& hd) { return hd.calibration_updates; }) == 1; }));
  ASSERT_TRUE(WaitFor([&] { return CountEvents(Events(), "was calibrated") == 1; }));
}

// Any pose would be taken for the arm's reset pose.
TEST_F(OpenHapticsTest, AnEncoderResetIsTheOperatorsOnly) {
  With([](FakeHd& hd) {
    hd.calibration_style = 1;
    hd.calibration = 0x5001;
    return 0;
  });
  StartStreaming();
  std::this_thread::sleep_for(milliseconds(50));
  EXPECT_EQ(With([](FakeHd& hd) { return hd.calibration_updates; }), 0u);
  EXPECT_TRUE(Contains(device_->health().problem, "reset pose"));
  device_->Calibrate();
  ASSERT_TRUE(
      WaitFor([&] { return With([](FakeHd& hd) { return hd.calibration_updates; }) == 1; }));
}

TEST_F(OpenHapticsTest, ADeviceWithoutCalibrationSaysSo) {
  With([](FakeHd& hd) { return hd.calibration_style = 0; });
  StartStreaming();
  EXPECT_TRUE(device_->health().calibrated);
  EXPECT_TRUE(Contains(ErrorOf([&] { device_->Calibrate(); }), "no calibration"));
}

TEST_F(OpenHapticsTest, StopEndsWithZeroForceAndInOrder) {
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
  device_->Stop();
  EXPECT_GE(With([](FakeHd& hd) { return hd.zero_frames_at_end; }), 1u);
  const std::vector<std::string> expected = {
      "hdInitDevice",     "hdSetSchedulerRate", "hdScheduleAsynchronous",
      "hdStartScheduler", "hdEnable",           "hdDisable",
      "hdStopScheduler",  "hdUnschedule",       "hdDisableDevice"};
  EXPECT_EQ(Calls(), expected);
  const std::uint64_t frames = With([](FakeHd& hd) { return hd.frames; });
  device_->Write(Vec3(1, 0, 0), 0.001);
  EXPECT_EQ(device_->Read(state_), DeviceStatus::kFault);
  device_->Stop();
  std::this_thread::sleep_for(milliseconds(20));
  EXPECT_EQ(With([](FakeHd& hd) { return hd.frames; }), frames);
  EXPECT_EQ(Calls(), expected);
}

TEST_F(OpenHapticsTest, StopBeforeADeviceIsFoundIsQuick) {
  With([](FakeHd& hd) { return hd.init_error = kCommError; });
  Start();
  ASSERT_TRUE(WaitFor([&] { return !device_->health().problem.empty(); }));
  device_->Stop();
  EXPECT_EQ(Calls(), std::vector<std::string>{"hdInitDevice"});
}

TEST_F(OpenHapticsTest, ALibraryThatHangsDoesNotHoldStop) {
  StartStreaming();
  ASSERT_TRUE(Tick(Vec3(1, 0, 0), [&] { return Force() == Vec3(1, 0, 0); }));
  With([](FakeHd& hd) { return hd.hangs_in_stop = true; });
  device_->Stop();
  EXPECT_EQ(device_->Read(state_), DeviceStatus::kFault);
  EXPECT_EQ(CountEvents(Events(), "does not release the device"), 1);
  device_->Write(Vec3(1, 0, 0), 0.001);
  EXPECT_TRUE(WaitFor([&] { return Force().isZero(0.0); }));
  device_.reset();
  With([](FakeHd& hd) { return hd.hangs_in_stop = false; });
  EXPECT_TRUE(WaitFor([&] { return Calls().back() == "hdDisableDevice"; }));
}

TEST_F(OpenHapticsTest, ADeviceStartsAgainAfterStop) {
  StartStreaming();
  device_->Stop();
  device_->Start();
  ASSERT_TRUE(Tick(Vec3(1, 0, 0),
                   [&] { return status_ == DeviceStatus::kOk && Force() == Vec3(1, 0, 0); }));
}

TEST(HdErrors, UnknownOnesHaveTheirNumberAndDoNoHarm) {
  EXPECT_EQ(hd::EffectOf(0x7777), hd::ErrorEffect::kCall);
  EXPECT_TRUE(Contains(hd::Describe({.code = 0x7777}), "0x7777"));
  EXPECT_EQ(hd::EffectOf(0), hd::ErrorEffect::kNone);
  EXPECT_EQ(hd::EffectOf(0x0300), hd::ErrorEffect::kBroken);
}

}  // namespace
}  // namespace palpate
