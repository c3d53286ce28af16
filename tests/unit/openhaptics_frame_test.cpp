// A frame by itself: what the HD library's thread does, called from here on functions
// of our own that do nothing but answer.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <numbers>

#include "server/device/openhaptics/hd_servo.h"
#include "tests/support/allocation_count.h"
#include "tests/support/device_numbers.h"
#include "tests/support/patience.h"

namespace palpate {
namespace {

using test::kNan;

struct FrameLibrary {
  double x_mm = 0.0;
  Eigen::Matrix4d X_DS = Eigen::Matrix4d::Identity();
  bool writes_transform = true;
  hd::Boolean inkwell_switch = 1;
  unsigned int error = 0;      // of every call of get_error
  unsigned int one_error = 0;  // once
  unsigned int calibration = hd::kCalibrationOk;
  int updates = 0;
  bool motors_on = false;
  int calls_of_get_error = 0;
  Vec3 force_n = Vec3::Constant(kNan);
};
FrameLibrary frame_library;

hd::Functions FunctionsOfLibrary() {
  hd::Functions functions;
  functions.enable = [](hd::Enum) { frame_library.motors_on = true; };
  functions.disable = [](hd::Enum) { frame_library.motors_on = false; };
  functions.make_current = [](hd::Handle) {};
  functions.begin_frame = [](hd::Handle) {};
  functions.end_frame = [](hd::Handle) {};
  functions.get_booleanv = [](hd::Enum, hd::Boolean* value) {
    *value = frame_library.inkwell_switch;
  };
  functions.get_integerv = [](hd::Enum, int* value) { *value = 1; };
  functions.get_doublev = [](hd::Enum name, double* value) {
    if (name == hd::kCurrentPosition) Eigen::Map<Vec3>{value} = Vec3(frame_library.x_mm, 0, 0);
    if (name != hd::kCurrentTransform || !frame_library.writes_transform) return;
    Eigen::Map<Eigen::Matrix4d>{value} = frame_library.X_DS;
  };
  functions.set_doublev = [](hd::Enum, const double* value) {
    frame_library.force_n = Vec3(value);
  };
  functions.get_error = [] {
    ++frame_library.calls_of_get_error;
    const unsigned int code =
        frame_library.one_error != 0 ? frame_library.one_error : frame_library.error;
    frame_library.one_error = 0;
    return hd::ErrorInfo{.code = code};
  };
  functions.check_calibration = [] { return frame_library.calibration; };
  functions.update_calibration = [](hd::Enum) { ++frame_library.updates; };
  return functions;
}

class HdFrameTest : public ::testing::Test {
 protected:
  HdFrameTest() {
    frame_library = FrameLibrary();
    Begin(hd::kStyleInkwell);
  }
  void Begin(hd::Enum style) {
    servo_.Begin({.handle = 1, .max_force_n = 2.0, .calibration_style = style});
    loop_.Set({&servo_});
  }
  void Frame() {
    EXPECT_EQ(HdLoop::Frame(&loop_), hd::kCallbackContinue);
    // As the control thread does.
    if (servo_.has_reading() && !servo_.seat.is_streaming()) servo_.seat.BeStreaming("", "");
  }
  void Write(const Vec3& force_n, bool motors_on = true) {
    servo_.seat.Write({.wrench_M = {force_n}, .motors_on = motors_on});
  }
  bool IsCalibrated() const { return servo_.seat.health("").calibrated; }
  Vec3 FrameWith(const Vec3& force_n) {
    Write(force_n);
    Frame();
    return frame_library.force_n;
  }
  // Once more if this machine stood still meanwhile, which looks like a silent servo. A force that
  // follows such a silence is held at zero until one of zero.
  Vec3 ForceOf(const Vec3& force_n) {
    for (;;) {
      FrameWith(Vec3::Zero());
      const std::uint64_t zeros = servo_.seat.counts.watchdog_zeros;
      const Vec3 written_n = FrameWith(force_n);
      if (servo_.seat.counts.watchdog_zeros == zeros) return written_n;
    }
  }

  HdServo servo_{FunctionsOfLibrary(), "openhaptics"};
  HdLoop loop_{FunctionsOfLibrary()};
  DeviceState state_;
};

TEST_F(HdFrameTest, AllocatesNothingWhateverComes) {
  Frame();
  const std::uint64_t before = test::Allocations();
  for (int i = 0; i < 2000; ++i) {
    frame_library.error = i < 500 || i > 1500 ? 0 : 0x0100 + static_cast<unsigned int>(i);
    frame_library.x_mm = i == 100 ? kNan : i;
    frame_library.calibration = hd::kCalibrationOk + static_cast<unsigned int>(i % 3);
    Write(Vec3(1, 2, 3) * i);
    Frame();
    servo_.Read(state_);
  }
  EXPECT_EQ(test::Allocations(), before);
}

TEST_F(HdFrameTest, ForcesAreFiniteAndLimitedByTheirNorm) {
  EXPECT_EQ(ForceOf(Vec3(0.3, 0.4, -0.5)), Vec3(0.3, 0.4, -0.5));
  EXPECT_TRUE(ForceOf(Vec3(-3, 0, 4)).isApprox(Vec3(-1.2, 0, 1.6)));
  EXPECT_TRUE(ForceOf(Vec3(1e300, 0, 0)).isApprox(Vec3(2, 0, 0)));
  EXPECT_EQ(ForceOf(Vec3(0, kNan, 0)), Vec3::Zero());
  EXPECT_EQ(ForceOf(Vec3(0, 0, test::kInfinity)), Vec3::Zero());
}

TEST_F(HdFrameTest, MotorsAreOffUntilTheyMayPushAndWhileItStops) {
  Frame();  // before the servo's first
  EXPECT_EQ(frame_library.force_n, Vec3::Zero());
  EXPECT_EQ(servo_.seat.counts.watchdog_zeros, 0u);
  Write(Vec3(1, 0, 0), false);
  Frame();
  EXPECT_FALSE(frame_library.motors_on);
  EXPECT_EQ(frame_library.force_n, Vec3::Zero());
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  EXPECT_TRUE(frame_library.motors_on);
  EXPECT_EQ(servo_.zero_frames(), 0u);
  servo_.BeginToStop();
  Frame();
  EXPECT_FALSE(frame_library.motors_on);
  EXPECT_EQ(frame_library.force_n, Vec3::Zero());
  EXPECT_EQ(servo_.zero_frames(), 1u);
}

TEST_F(HdFrameTest, ReadingsOfTheConnectionBeforeAreAFault) {
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  Frame();
  EXPECT_NE(servo_.Read(state_), DeviceStatus::kFault);
  servo_.seat.SetConnection(DeviceConnection::kAbsent);
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  Begin(hd::kStyleInkwell);
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  Frame();
  EXPECT_NE(servo_.Read(state_), DeviceStatus::kFault);
}

// A quarter turn about y, by columns: x goes to -z, z to x. By rows it is its inverse.
TEST_F(HdFrameTest, TheColumnsOfTheTransformAreTheStylussAxes) {
  frame_library.X_DS.topLeftCorner<3, 3>() =
      Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitY()).toRotationMatrix();
  frame_library.x_mm = 10.0;
  Frame();
  EXPECT_NE(servo_.Read(state_), DeviceStatus::kFault);
  EXPECT_TRUE((state_.R_MS * Vec3::UnitX()).isApprox(-Vec3::UnitZ(), 1e-9));
  EXPECT_TRUE((state_.R_MS * Vec3::UnitZ()).isApprox(Vec3::UnitX(), 1e-9));
  EXPECT_EQ(state_.p_MHip_mm, Vec3(10, 0, 0));
}

TEST_F(HdFrameTest, WhatIsNoPoseOrIsNotWrittenIsNoReading) {
  frame_library.x_mm = 7.0;
  Frame();
  const auto expect_dropped = [&] {
    const std::uint64_t dropped = servo_.seat.counts.corrupt_frames;
    Frame();
    EXPECT_EQ(servo_.seat.counts.corrupt_frames, dropped + 1);
    EXPECT_EQ(servo_.seat.counts.readings, 1u);
    servo_.Read(state_);
    EXPECT_EQ(state_.p_MHip_mm.x(), 7.0);
  };
  frame_library.writes_transform = false;
  expect_dropped();
  frame_library.writes_transform = true;
  const Eigen::Vector3d doubled(2, 2, 2), mirrored(-1, 1, 1), none(0, 0, 0);
  for (const Eigen::Vector3d& diagonal : {doubled, mirrored, none}) {
    frame_library.X_DS.topLeftCorner<3, 3>() = diagonal.asDiagonal();
    expect_dropped();
  }
  frame_library.X_DS.setIdentity();
  frame_library.x_mm = kNan;
  expect_dropped();
}

TEST_F(HdFrameTest, TheInkwellSwitchReadsZeroInside) {
  for (const bool is_in : {true, false}) {
    frame_library.inkwell_switch = is_in ? 0 : 1;
    Frame();
    servo_.Read(state_);
    EXPECT_EQ(state_.docked, is_in);
    EXPECT_EQ(servo_.seat.health("").docked, is_in);
  }
  // A device without an inkwell may return anything.
  Begin(hd::kStyleEncoderReset);
  frame_library.inkwell_switch = 0;
  Frame();
  servo_.Read(state_);
  EXPECT_FALSE(state_.docked);
}

// Any pose would be taken for the arm's reset pose.
TEST_F(HdFrameTest, TheInkwellCalibratesByItselfAndAnEncoderResetIsTheOperatorsOnly) {
  frame_library.calibration = hd::kCalibrationNeedsUpdate;
  Frame();
  EXPECT_EQ(frame_library.updates, 1);
  Begin(hd::kStyleEncoderReset);
  for (int i = 0; i < 200; ++i) Frame();
  EXPECT_EQ(frame_library.updates, 1);
  servo_.RequestCalibration();
  Frame();
  EXPECT_EQ(frame_library.updates, 2);
  EXPECT_FALSE(IsCalibrated());
  frame_library.calibration = hd::kCalibrationOk;
  Frame();
  EXPECT_TRUE(IsCalibrated());
}

// The position may jump: the old force waits for a zero of the servo.
TEST_F(HdFrameTest, ACalibrationHoldsTheForce) {
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  frame_library.calibration = hd::kCalibrationNeedsUpdate;
  EXPECT_EQ(FrameWith(Vec3(1, 0, 0)), Vec3::Zero());
  frame_library.calibration = hd::kCalibrationOk;
  EXPECT_EQ(FrameWith(Vec3(1, 0, 0)), Vec3::Zero());
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
}

TEST_F(HdFrameTest, TenBadFramesInARowAreTheLossOrOneOfABrokenDevice) {
  for (int round = 0; round < 2; ++round) {
    frame_library.error = 0x0302;
    for (int i = 0; i < HdServo::kLostFrames - 1; ++i) Frame();
    EXPECT_FALSE(servo_.lost());
    frame_library.error = 0;
    EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  }
  frame_library.error = 0x0302;
  const std::uint64_t readings = servo_.seat.counts.readings;
  for (int i = 0; i < HdServo::kLostFrames; ++i) Frame();
  EXPECT_TRUE(servo_.lost());
  frame_library.error = 0;
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  EXPECT_EQ(servo_.seat.counts.readings, readings);

  Begin(hd::kStyleInkwell);
  Frame();
  EXPECT_FALSE(servo_.lost());
  frame_library.one_error = 0x0300;
  Frame();
  EXPECT_TRUE(servo_.lost());
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
}

TEST_F(HdFrameTest, AForceErrorIsZeroFromTheNextFrameForAWhile) {
  using Clock = std::chrono::steady_clock;
  const std::chrono::milliseconds a_while(HdServo::kForceErrorMs);
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  const std::uint64_t readings = servo_.seat.counts.readings;
  const Clock::time_point began = Clock::now();
  frame_library.one_error = 0x0201;
  Frame();
  EXPECT_EQ(servo_.seat.counts.readings, readings + 1);
  const Vec3 force = ForceOf(Vec3(1, 0, 0));
  const DeviceStatus status = servo_.Read(state_);
  if (Clock::now() - began < a_while) {
    EXPECT_EQ(force, Vec3::Zero());
    EXPECT_EQ(status, DeviceStatus::kFault);
  }
  EXPECT_TRUE(test::Eventually([&] { return ForceOf(Vec3(1, 0, 0)) == Vec3(1, 0, 0); }));
  EXPECT_GE(Clock::now() - began, a_while);
  EXPECT_NE(servo_.Read(state_), DeviceStatus::kFault);
}

TEST_F(HdFrameTest, ALibraryThatIsNeverWithoutErrorsIsAskedEightTimes) {
  frame_library.error = 0x0100;
  Frame();
  EXPECT_EQ(frame_library.calls_of_get_error, 8);
  EXPECT_EQ(servo_.seat.counts.readings, 1u);
}

TEST_F(HdFrameTest, ALibraryThatStaysUncalibratedIsNotAskedEveryFrame) {
  frame_library.calibration = hd::kCalibrationNeedsUpdate;
  for (int i = 0; i < 1000; ++i) Frame();
  EXPECT_GE(frame_library.updates, 5);
  EXPECT_LE(frame_library.updates, 10);
  EXPECT_FALSE(IsCalibrated());
}

}  // namespace
}  // namespace palpate
