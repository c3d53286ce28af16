// The arm of an Omni: what its readings mean, and what forces become.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <random>
#include <vector>

#include "common/error/error.h"
#include "server/device/omni/omni_arm.h"
#include "tests/support/allocation_count.h"
#include "tests/support/device_numbers.h"
#include "tests/support/omni_frames.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using test::kInfinity;
using test::kNan;
using test::OmniReading;

// The published formulas, written down a second time.
Vec3 Published(const std::array<double, 3>& t) {
  const double l = 133.35, r = l * std::cos(t[1]) + l * std::sin(t[2]);
  return {-std::sin(t[0]) * r, l * std::sin(t[1]) - l * std::cos(t[2]) + 23.35,
          std::cos(t[0]) * r - 168.35};
}

class OmniArmTest : public ::testing::Test {
 protected:
  std::optional<std::uint32_t> Take(const OmniReading& reading) {
    return arm_->Take(*DecodeOmniState(test::OmniStatePayload(reading)), state_);
  }
  // A docked one so often that it counts; with a counter of its own.
  void Receive(OmniReading reading) {
    for (int n = reading.docked ? kOmniRestReadings : 1; n > 0; --n) {
      reading.counter = ++counter_;
      EXPECT_EQ(Take(reading), 0u);
    }
  }
  bool IsOff(const Vec3& force_D_n, bool forces_on = true) {
    const OmniForce force = arm_->ForceOf(force_D_n, forces_on);
    return !force.force_enabled && force.motors == std::array<int, 3>{};
  }
  // In the dock the shoulder is at 0.23 rad and the elbow at -0.37 rad, after a public driver.
  bool IsAtRest() const {
    return (state_.p_MHip_mm - Published({0.0, 0.23, -0.37})).norm() < 1e-9 &&
           (state_.p_MHip_mm - Vec3(0.0, -70.6, -86.7)).norm() < 0.1;
  }

  std::optional<OmniArm> arm_{std::in_place};
  DeviceState state_;

 private:
  std::uint32_t counter_ = 1000;
};

TEST_F(OmniArmTest, APositionIsThatOfThePublishedFormulas) {
  Receive({.encoders = {100, -200, 300}, .docked = true});
  EXPECT_TRUE(IsAtRest());
  EXPECT_TRUE(state_.docked);
  EXPECT_TRUE(state_.calibrated);
  std::mt19937 random(1);
  for (int n = 0; n < 1000; ++n) {
    const auto any = [&] { return static_cast<int>(random() % 4001) - 2000; };
    const std::array<int, 3> moved = {any(), any(), any()};
    Receive({.encoders = {100 + moved[0], -200 + moved[1], 300 + moved[2]}});
    EXPECT_FALSE(state_.docked);
    const double rad = 2.0 * std::numbers::pi / 15000.0;
    const Vec3 place_mm =
        Published({moved[0] * rad, -moved[1] * rad + 0.23, moved[2] * rad - 0.37});
    ASSERT_LT((state_.p_MHip_mm - place_mm).norm(), 1e-9);
  }
}

TEST_F(OmniArmTest, ButtonsAreActiveLow) {
  for (unsigned pressed = 0; pressed < 4; ++pressed) {
    for (const bool docked : {false, true}) {
      Receive({.pressed = pressed, .docked = docked});
      EXPECT_EQ(state_.buttons, pressed);
      EXPECT_EQ(state_.docked, docked);
    }
  }
}

TEST_F(OmniArmTest, GapsInTheCounterAreLostReadingsAndTheSameFrameAgainIsNone) {
  const auto lost = [&](std::uint32_t counter) { return Take({.counter = counter}); };
  EXPECT_EQ(lost(0xfffffff0u), 0u);  // the first: nothing to compare with
  EXPECT_EQ(lost(0xfffffff1u), 0u);
  EXPECT_EQ(lost(0xfffffff4u), 2u);
  EXPECT_EQ(lost(0xffffffffu), 10u);
  EXPECT_EQ(lost(0u), 0u);  // it wraps
  EXPECT_EQ(lost(1000u), 999u);
  state_.p_MHip_mm = Vec3(1, 2, 3);
  EXPECT_EQ(lost(1000u), std::nullopt);  // the same once more
  EXPECT_EQ(state_.p_MHip_mm, Vec3(1, 2, 3));
  EXPECT_EQ(lost(990u), 0u);        // back
  EXPECT_EQ(lost(0x1000000u), 0u);  // a damaged number is no gap
  EXPECT_EQ(lost(991u), 0u);
  EXPECT_EQ(lost(993u), 1u);
}

// omni_test.cpp has the axes for all angles.
TEST_F(OmniArmTest, TheGimbalTurnsTheStylus) {
  Receive({.docked = true});
  const Vec3 barrel(0.0, -std::sin(0.37), std::cos(0.37));  // the elbow is there in the dock
  EXPECT_LT((state_.R_MS * Vec3::UnitZ() - barrel).norm(), 1e-9);
  EXPECT_LT((state_.R_MS * Vec3::UnitX() - Vec3::UnitX()).norm(), 1e-9);
  // A roll of the barrel leaves its direction; the other two do not.
  Receive({.gimbal_per_mille = {500, 500, 700}});
  EXPECT_LT((state_.R_MS * Vec3::UnitZ() - barrel).norm(), 1e-9);
  EXPECT_GT((state_.R_MS * Vec3::UnitX() - Vec3::UnitX()).norm(), 0.5);
  for (const auto& turned : {std::array{700, 500, 500}, std::array{500, 700, 500}}) {
    Receive({.gimbal_per_mille = turned});
    EXPECT_GT((state_.R_MS * Vec3::UnitZ() - barrel).norm(), 0.5);
  }
}

TEST_F(OmniArmTest, RandomReadingsDoNoHarm) {
  arm_.emplace(OmniArm::Gains{2.0, 2.0, 2.0});
  std::mt19937 random(5);
  for (int n = 0; n < test::Scaled(20000); ++n) {
    std::array<std::uint8_t, kOmniStateBytes> bytes{};
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    if (const auto reading = DecodeOmniState(bytes)) arm_->Take(*reading, state_);
    ASSERT_TRUE(state_.p_MHip_mm.allFinite() && state_.R_MS.coeffs().allFinite());
    ASSERT_LE(state_.p_MHip_mm.norm(), 600.0);
    for (const int motor : arm_->ForceOf(Vec3(3, -3, 3), true).motors) {
      ASSERT_LE(std::abs(motor), kOmniMotorRange);
    }
  }
}

TEST_F(OmniArmTest, UntilTheFirstDockPositionsHaveNoMeaning) {
  arm_.emplace(OmniArm::Gains{2.0, 2.0, 2.0});
  Receive({.encoders = {500, 500, 500}});
  EXPECT_FALSE(state_.calibrated);
  EXPECT_TRUE(IsOff(Vec3(0, 1, 0)));
  Receive({.encoders = {500, 500, 500}, .docked = true});
  EXPECT_TRUE(state_.calibrated);
  EXPECT_FALSE(IsOff(Vec3(0, 1, 0)));
  // Every docking says it anew.
  Receive({.encoders = {510, 510, 510}, .docked = true});
  EXPECT_TRUE(IsAtRest());
  // On request the next one does.
  arm_->RequestCalibration();
  Receive({.encoders = {40, 50, 60}});
  EXPECT_FALSE(state_.calibrated);
  Receive({.encoders = {40, 50, 60}, .docked = true});
  EXPECT_TRUE(IsAtRest());
}

TEST_F(OmniArmTest, ADockCountsOnceTheStylusRests) {
  std::uint32_t counter = 1;
  const auto dock = [&](std::int16_t at) {
    Take({.encoders = {at, 0, 0}, .docked = true, .counter = ++counter});
  };
  for (std::int16_t at = 0; at < 500; ++at) dock(at);  // it slides in
  EXPECT_FALSE(state_.calibrated);
  for (int n = 1; n < kOmniRestReadings - 1; ++n) dock(499);
  EXPECT_FALSE(state_.calibrated);
  dock(499);
  EXPECT_TRUE(state_.calibrated);
  // One damaged frame moves nothing.
  dock(77);
  EXPECT_FALSE(IsAtRest());
  dock(499);
  EXPECT_TRUE(IsAtRest());
}

TEST_F(OmniArmTest, TheEncodersMayWrap) {
  Receive({.encoders = {32760, -32760, 32767}, .docked = true});
  Receive({.encoders = {32760 + 100, -32760 - 100, 32767 + 100}});
  const Vec3 near_wrap_mm = state_.p_MHip_mm;
  Receive({.docked = true});
  Receive({.encoders = {100, -100, 100}});
  EXPECT_EQ(near_wrap_mm, state_.p_MHip_mm);
}

// omni_test.cpp has the torques.
TEST_F(OmniArmTest, AForceBecomesTheTorquesTimesTheMotorsGainsWithinTheMotors) {
  const Vec3 gains(2.0, -3.0, 1.5);
  arm_.emplace(OmniArm::Gains{gains[0], gains[1], gains[2]});
  Receive({.docked = true});
  std::mt19937 random(4);
  const auto any = [&](double limit) {
    return std::uniform_real_distribution<double>(-limit, limit)(random);
  };
  for (int n = 0; n < 2000; ++n) {
    const auto counts = [&] { return static_cast<std::int16_t>(any(2000)); };
    const std::array<std::int16_t, 3> at = {counts(), counts(), counts()};
    Receive({.encoders = {at[0], at[1], at[2]}});
    const double limit_n = n % 2 == 0 ? 1.9 : 20.0;
    const Vec3 force(any(limit_n), any(limit_n), any(limit_n));
    const OmniForce sent = arm_->ForceOf(force, true);
    ASSERT_TRUE(sent.force_enabled);
    OmniJoints joints = OmniJointsFromCounts(at);
    joints.shoulder_rad += 0.23;
    joints.elbow_rad -= 0.37;
    Vec3 wanted = gains.cwiseProduct(OmniTorques_n_mm(joints, force));
    wanted *= std::min(1.0, 2047.0 / wanted.cwiseAbs().maxCoeff());
    for (int joint = 0; joint < 3; ++joint) {
      ASSERT_NEAR(sent.motors[static_cast<std::size_t>(joint)], wanted[joint], 0.51);
    }
  }
  for (const double huge : {1e6, 1e100, 1e300, 1.7e308}) {
    for (const int counts : arm_->ForceOf(Vec3(huge, -huge, huge), true).motors) {
      EXPECT_LE(std::abs(counts), 2047);
    }
  }
}

TEST_F(OmniArmTest, ForcesAreOffUnlessEverythingIsThere) {
  Receive({.docked = true});
  EXPECT_TRUE(IsOff(Vec3(1, 1, 1)));  // no motors
  arm_.emplace(OmniArm::Gains{2.0, 2.0, 2.0});
  EXPECT_TRUE(IsOff(Vec3(1, 1, 1)));  // no reading yet
  Receive({.docked = true});
  EXPECT_FALSE(IsOff(Vec3(1, 1, 1)));
  EXPECT_TRUE(IsOff(Vec3(1, 1, 1), false));
  for (const double bad : {kNan, kInfinity, -kInfinity}) EXPECT_TRUE(IsOff(Vec3(0, bad, 0)));
}

TEST_F(OmniArmTest, ANewConnectionForgetsTheLast) {
  Receive({.docked = true});
  arm_->Forget();
  EXPECT_EQ(Take({.counter = 5}), 0u);
  EXPECT_FALSE(state_.calibrated);
}

TEST_F(OmniArmTest, NothingAllocates) {
  arm_.emplace(OmniArm::Gains{2.0, 2.0, 2.0});
  OmniState reading = *DecodeOmniState(test::OmniStatePayload({.docked = true}));
  const std::uint64_t before = test::Allocations();
  for (int n = 0; n < 1000; ++n) {
    ++reading.counter;
    arm_->Take(reading, state_);
    arm_->ForceOf(Vec3(1, 2, 3), n % 2 == 0);
    arm_->RequestCalibration();
  }
  EXPECT_EQ(test::Allocations(), before);
}

TEST(OmniArm, GainsThatSaturateTheMotorsAreRefused) {
  for (const double bad : {10.1, -10.1, kNan})
    EXPECT_THROW((OmniArm(OmniArm::Gains{1.0, bad, 1.0})), Error);
}

}  // namespace
}  // namespace palpate
