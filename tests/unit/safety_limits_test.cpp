// The limits of the safety stage, one by one: force, slew, warmth, speed and missed ticks.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "server/safety/safety.h"
#include "tests/unit/safety_rig.h"

namespace palpate {
namespace {

TEST(Safety, LimitsOfADevice) {
  const SafetyLimits hardware = LimitsFor(Hardware(), 2);
  EXPECT_EQ(hardware.max_force_n, 3.3);
  EXPECT_EQ(hardware.continuous_force_n, 0.88);
  EXPECT_FALSE(hardware.starts_on);
  EXPECT_TRUE(hardware.faults_stay);
  EXPECT_GT(hardware.max_speed_mm_per_s, 0.0);
  EXPECT_EQ(hardware.stop_buttons, 2u);
  DeviceSpec simulated = Hardware();
  simulated.verification_level = VerificationLevel::kSimulated;
  EXPECT_EQ(LimitsFor(simulated, 0), SafetyLimits{});
}

TEST(Safety, ReachesAForceWithinTheLimits) {
  Rig rig = Simulated();
  EXPECT_NEAR(rig.Tick().norm(), 0.2, 1e-12);
  EXPECT_NEAR((rig.Tick(20) - kPush_n).norm(), 0.0, 1e-12);
}

// --- Warmth

TEST(Safety, ALongPushGoesDownToTheContinuousForce) {
  Rig rig = On();
  rig.input.force_D_n = Vec3(0, 0, 10);
  EXPECT_NEAR(rig.Tick(20).norm(), 3.3, 0.05);
  double heat_n2 = 0.0;
  for (int n = 0; n < 120'000; ++n) {
    heat_n2 += (rig.Tick().squaredNorm() - heat_n2) * (1 - std::exp(-kDtS / 10.0));
    ASSERT_LE(heat_n2, 0.88 * 0.88 * 1.001);
  }
  EXPECT_NEAR(rig.Tick().norm(), 0.88, 0.01);
  EXPECT_NEAR(rig.safety.limit_n(), 0.88, 0.01);
  EXPECT_STATE(rig, kOn, kNone);
  // At rest the motor cools, and the full force is available again.
  rig.input.force_D_n.setZero();
  rig.Tick(20'000);
  EXPECT_EQ(rig.safety.limit_n(), 3.3);
}

TEST(Safety, TheContinuousForceIsNeverShortened) {
  Rig rig = On();
  rig.input.force_D_n = Vec3(0.88, 0, 0);
  EXPECT_NEAR(rig.Tick(200'000).norm(), 0.88, 1e-9);
}

// --- Speed

TEST(Safety, AHandsMotionIsNoFault) {
  Rig rig = On();
  for (int n = 0; n < 10'000; ++n) {
    // 60 mm to and fro at 4 Hz: 1.5 m/s, with the resolution of the device. Every seventh reading
    // is late.
    const double p_mm = 60.0 * std::sin(2 * M_PI * 4.0 * n * kDtS);
    if (n % 7 != 0) rig.input.p_DHip_mm.x() = 0.055 * std::round(p_mm / 0.055);
    rig.Tick();
    ASSERT_EQ(rig.safety.state(), ForceState::kOn) << n;
  }
}

TEST(Safety, ReadingsAfterAPauseAreNoJump) {
  Rig rig = On();
  rig.input.device = DeviceStatus::kStale;
  rig.Tick(50);
  rig.input.device = DeviceStatus::kOk;
  rig.input.p_DHip_mm.x() += 40.0;  // 0.8 m/s over the 50 ms
  rig.Tick();
  EXPECT_STATE(rig, kRampIn, kNone);
}

TEST(Safety, ARunawayIsCutOff) {
  Rig rig = On();
  int ticks = 0;
  // 3 m/s from rest at 300 m/s²: a motor that pulls a hundred grams with 30 N.
  for (double v = 0.0; rig.safety.state() == ForceState::kOn && ticks < 100; ++ticks) {
    v = std::min(v + 300.0, 3000.0);
    rig.input.p_DHip_mm.x() += v * kDtS;
    rig.Tick();
  }
  EXPECT_STATE(rig, kFault, kSpeed);
  EXPECT_LE(ticks, 15);
}

// README: above 2 m/s.
TEST(Safety, TheFastestHandMovesAtTwoMetresPerSecond) {
  for (const double speed_mm_per_s : {1950.0, 2050.0}) {
    Rig rig = On();
    for (int n = 0; n < 200; ++n) {
      rig.input.p_DHip_mm.x() += speed_mm_per_s * kDtS;
      rig.Tick();
    }
    const bool is_too_fast = speed_mm_per_s > 2000.0;
    EXPECT_EQ(rig.safety.state(), is_too_fast ? ForceState::kFault : ForceState::kOn);
    EXPECT_EQ(rig.safety.reason(), is_too_fast ? ForceReason::kSpeed : ForceReason::kNone);
  }
}

TEST(Safety, CalibratingIsNoMotion) {
  Rig rig = On();
  rig.input.calibrated = false;
  rig.Tick();
  rig.input.p_DHip_mm.x() += 100.0;
  rig.input.calibrated = true;
  rig.Tick();
  EXPECT_STATE(rig, kRampIn, kNone);
}

// --- Deadlines

TEST(Safety, OneMissedTickOfTwentyIsNoCause) {
  Rig rig = On();
  for (int n = 0; n < 20'000; ++n) {
    rig.input.missed_ticks = n % 20 == 0;
    rig.Tick();
  }
  EXPECT_STATE(rig, kOn, kNone);
  rig.input.missed_ticks = 15;  // the machine stopped
  rig.Tick();
  EXPECT_STATE(rig, kOn, kNone);
  for (int n = 0; n < 100; ++n) {
    rig.input.missed_ticks = 1;
    rig.Tick();
  }
  EXPECT_STATE(rig, kHeld, kDeadlines);
}

// README: more than 20 missed ticks beyond 5 %. One missed tick in ten is 0.05 more per tick.
TEST(Safety, OneMissedTickOfTenIsACauseAfterFourHundred) {
  Rig rig = On();
  const auto tick = [&](int from, int to) {
    for (int n = from; n < to; ++n) {
      rig.input.missed_ticks = n % 10 == 0;
      rig.Tick();
    }
  };
  tick(0, 350);
  EXPECT_STATE(rig, kOn, kNone);
  tick(350, 450);
  EXPECT_STATE(rig, kHeld, kDeadlines);
}

// A loop that still misses ticks now and then must not bring forces back in between.
TEST(Safety, ForcesComeBackOnceNearlyNoMissedTickIsLeft) {
  Rig rig = On();
  rig.input.missed_ticks = 30;
  rig.Tick();
  rig.Tick(550);  // of 29 missed ticks beyond 5 %, 27 are forgotten
  EXPECT_STATE(rig, kHeld, kDeadlines);
  rig.Tick(50);
  EXPECT_STATE(rig, kRampIn, kNone);
}

}  // namespace
}  // namespace palpate
