// A frame by itself: what the HD library's thread does, called from here on functions
// of our own that do nothing but answer.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <limits>
#include <thread>

#include "server/device/openhaptics/hd_servo.h"
#include "tests/support/allocation_count.h"

namespace palpate {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

struct Library {
  double x_mm = 0.0;
  bool writes_transform = true;
  unsigned int error = 0;      // of every call of get_error
  unsigned int one_error = 0;  // once
  unsigned int calibration = hd::kCalibrationOk;
  int updates = 0;
  bool motors_on = false;
  int calls_of_get_error = 0;
  Vec3 force_n = Vec3::Constant(kNan);
};
Library library;

hd::Functions FunctionsOfLibrary() {
  hd::Functions functions;
  functions.enable = [](hd::Enum) { library.motors_on = true; };
  functions.disable = [](hd::Enum) { library.motors_on = false; };
  functions.begin_frame = [](hd::Handle) {};
  functions.end_frame = [](hd::Handle) {};
  functions.get_booleanv = [](hd::Enum, hd::Boolean* value) { *value = 1; };
  functions.get_integerv = [](hd::Enum, int* value) { *value = 1; };
  functions.get_doublev = [](hd::Enum name, double* value) {
    if (name == hd::kCurrentPosition) Eigen::Map<Vec3>{value} = Vec3(library.x_mm, 0, 0);
    if (name != hd::kCurrentTransform || !library.writes_transform) return;
    Eigen::Map<Eigen::Matrix4d>{value}.setIdentity();
  };
  functions.set_doublev = [](hd::Enum, const double* value) { library.force_n = Vec3(value); };
  functions.get_error = [] {
    ++library.calls_of_get_error;
    const unsigned int code = library.one_error != 0 ? library.one_error : library.error;
    library.one_error = 0;
    return hd::ErrorInfo{.code = code};
  };
  functions.check_calibration = [] { return library.calibration; };
  functions.update_calibration = [](hd::Enum) { ++library.updates; };
  return functions;
}

class HdFrameTest : public testing::Test {
 protected:
  HdFrameTest() {
    library = Library();
    Begin(hd::kStyleInkwell);
  }
  void Begin(hd::Enum style) {
    servo_.Begin({.handle = 1, .max_force_n = 2.0, .calibration_style = style});
  }
  void Frame() { EXPECT_EQ(HdServo::Frame(&servo_), hd::kCallbackContinue); }
  Vec3 ForceOf(const Vec3& force_n) {
    servo_.Write(force_n, true);
    Frame();
    return library.force_n;
  }

  HdServo servo_{FunctionsOfLibrary()};
  DeviceState state_;
};

TEST_F(HdFrameTest, AllocatesNothingWhateverComes) {
  const std::uint64_t before = test::Allocations();
  for (int i = 0; i < 2000; ++i) {
    library.error = i < 500 || i > 1500 ? 0 : 0x0100 + static_cast<unsigned int>(i);
    library.x_mm = i == 100 ? kNan : i;
    library.calibration = hd::kCalibrationOk + static_cast<unsigned int>(i % 3);
    servo_.Write(Vec3(1, 2, 3) * i, true);
    Frame();
    servo_.Read(state_);
  }
  EXPECT_EQ(test::Allocations(), before);
}

TEST_F(HdFrameTest, NoForceBeforeTheServosFirst) {
  Frame();
  EXPECT_EQ(library.force_n, Vec3::Zero());
  EXPECT_EQ(servo_.counts().watchdog_zeros, 0u);
}

TEST_F(HdFrameTest, ForcesAreFiniteAndLimitedByTheirNorm) {
  EXPECT_EQ(ForceOf(Vec3(0.3, 0.4, -0.5)), Vec3(0.3, 0.4, -0.5));
  EXPECT_TRUE(ForceOf(Vec3(-3, 0, 4)).isApprox(Vec3(-1.2, 0, 1.6)));
  EXPECT_TRUE(ForceOf(Vec3(1e300, 0, 0)).isApprox(Vec3(2, 0, 0)));
  EXPECT_EQ(ForceOf(Vec3(0, kNan, 0)), Vec3::Zero());
  EXPECT_EQ(ForceOf(Vec3(0, 0, std::numeric_limits<double>::infinity())), Vec3::Zero());
}

TEST_F(HdFrameTest, AnOldForceIsZeroAndANewOneBeginsAtZero) {
  servo_.Write(Vec3(1, 0, 0), true);
  std::this_thread::sleep_for(std::chrono::milliseconds(HdServo::kServoSilentMs + 1));
  Frame();
  EXPECT_EQ(library.force_n, Vec3::Zero());
  EXPECT_FALSE(library.motors_on);
  EXPECT_EQ(servo_.counts().watchdog_zeros, 1u);
  // The old force does not come back in one step: zero stays until the servo says zero.
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kStale);
  EXPECT_EQ(ForceOf(Vec3::Zero()), Vec3::Zero());
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kOk);
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  EXPECT_TRUE(library.motors_on);
}

TEST_F(HdFrameTest, MotorsAreOffUntilTheyMayPush) {
  servo_.Write(Vec3(1, 0, 0), false);
  Frame();
  EXPECT_FALSE(library.motors_on);
  EXPECT_EQ(library.force_n, Vec3::Zero());
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  EXPECT_TRUE(library.motors_on);
  servo_.BeginToStop();
  Frame();
  EXPECT_FALSE(library.motors_on);
  EXPECT_EQ(library.force_n, Vec3::Zero());
}

TEST_F(HdFrameTest, ReadingsOfTheConnectionBeforeAreAFault) {
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  Frame();
  EXPECT_NE(servo_.Read(state_), DeviceStatus::kFault);
  servo_.End();
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  Begin(hd::kStyleInkwell);
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  Frame();
  EXPECT_NE(servo_.Read(state_), DeviceStatus::kFault);
}

TEST_F(HdFrameTest, AValueThatTheLibraryDoesNotWriteIsNoReading) {
  library.writes_transform = false;
  Frame();
  EXPECT_EQ(servo_.counts().readings, 0u);
  EXPECT_EQ(servo_.counts().corrupt_frames, 1u);
}

TEST_F(HdFrameTest, TenBadFramesInARowAreTheLossAndNineAreNot) {
  for (int round = 0; round < 2; ++round) {
    library.error = 0x0302;
    for (int i = 0; i < HdServo::kLostFrames - 1; ++i) Frame();
    EXPECT_FALSE(servo_.lost());
    library.error = 0;
    EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  }
  library.error = 0x0302;
  for (int i = 0; i < HdServo::kLostFrames; ++i) Frame();
  EXPECT_TRUE(servo_.lost());
  library.error = 0;
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  EXPECT_EQ(servo_.counts().readings, 2u);
}

TEST_F(HdFrameTest, ABrokenDeviceIsLostAtOnce) {
  library.one_error = 0x0300;
  Frame();
  EXPECT_TRUE(servo_.lost());
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
}

TEST_F(HdFrameTest, AForceErrorIsZeroInTheNextFrame) {
  library.one_error = 0x0201;
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
  EXPECT_EQ(servo_.Read(state_), DeviceStatus::kFault);
  EXPECT_EQ(servo_.counts().readings, 2u);
}

TEST_F(HdFrameTest, ALibraryThatIsNeverWithoutErrorsIsAskedEightTimes) {
  library.error = 0x0100;
  Frame();
  EXPECT_EQ(library.calls_of_get_error, 8);
  EXPECT_EQ(servo_.counts().readings, 1u);
}

TEST_F(HdFrameTest, StoppingCountsFramesOfZeroOnly) {
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3(1, 0, 0));
  EXPECT_EQ(servo_.zero_frames(), 0u);
  servo_.BeginToStop();
  EXPECT_EQ(ForceOf(Vec3(1, 0, 0)), Vec3::Zero());
  EXPECT_EQ(servo_.zero_frames(), 1u);
}

TEST_F(HdFrameTest, ALibraryThatStaysUncalibratedIsNotAskedEveryFrame) {
  library.calibration = hd::kCalibrationNeedsUpdate;
  for (int i = 0; i < 1000; ++i) Frame();
  EXPECT_GE(library.updates, 5);
  EXPECT_LE(library.updates, 10);
  EXPECT_FALSE(servo_.calibrated());
}

}  // namespace
}  // namespace palpate
