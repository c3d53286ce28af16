// For all computed forces and all device states, the force on the hand is finite, bounded and
// gradual, and zero when it must be.
#include "server/safety/safety.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <iterator>
#include <random>
#include <vector>

#include "tests/support/device_numbers.h"

namespace palpate {
namespace {

using test::kInfinity;
using test::kNan;

constexpr double kDtS = 1e-3;
const Vec3 kPush_n(0.3, -1.2, 2.0);

DeviceDescription Hardware() {
  DeviceDescription spec;
  spec.kind = "fake";
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

// The torque's limits, as multiples of the force's.
constexpr double kArmMm = 50.0 / 3.3;

SafetyLimits WithTorque(SafetyLimits limits) {
  limits.max_torque_n_mm = kArmMm * limits.max_force_n;
  limits.max_torque_slew_n_mm_per_s = kArmMm * limits.max_slew_n_per_s;
  limits.continuous_torque_n_mm = kArmMm * limits.continuous_force_n;
  return limits;
}

// A safety stage and its input. A test changes the input. The torque is to do all that the force
// does: it is asked for, and limited, by the same multiple.
struct Rig {
  explicit Rig(const SafetyLimits& limits) : safety(WithTorque(limits)) {}

  Vec3 Tick(int count = 1) {
    Vec3 force_n = Vec3::Zero();
    for (int n = 0; n < count; ++n) {
      input.wrench_D.torque_n_mm = kArmMm * input.wrench_D.force_n;
      const Wrench wrench = safety.Step(input, kDtS);
      force_n = wrench.force_n;
      EXPECT_LT((wrench.torque_n_mm / kArmMm - force_n).norm(), 1e-9);
      EXPECT_EQ(wrench.torque_n_mm.isZero(0.0), force_n.isZero(0.0));
      EXPECT_NEAR(safety.torque_limit_n_mm() / kArmMm, safety.limit_n(), 1e-9);
      input.command = ForceCommand::kNone;
      input.missed_ticks = 0;
    }
    return force_n;
  }
  Vec3 Tell(ForceCommand command) {
    input.command = command;
    return Tick();
  }
  // Returns the force after every ramp has ended.
  Vec3 Settle() { return Tick(600); }

  Safety safety;
  SafetyInput input{.wrench_D = {kPush_n}};
};

Rig Simulated() { return Rig(SafetyLimits{}); }
Rig On() {
  Rig rig(LimitsFor(Hardware(), 3));
  rig.Tell(ForceCommand::kEnable);
  rig.Settle();
  return rig;
}

#define EXPECT_STATE(rig, the_state, the_reason)          \
  EXPECT_EQ((rig).safety.state(), ForceState::the_state); \
  EXPECT_EQ((rig).safety.reason(), ForceReason::the_reason)

TEST(Safety, HardwareIsOffUntilItIsEnabledAndThenRampsIn) {
  Rig rig(LimitsFor(Hardware(), 0));
  EXPECT_TRUE(rig.Tick(1000).isZero());
  EXPECT_STATE(rig, kOff, kOperator);
  double last_n = rig.Tell(ForceCommand::kEnable).norm();
  EXPECT_STATE(rig, kRampIn, kNone);
  for (int n = 1; n < 500; ++n) {
    const double force_n = rig.Tick().norm();
    EXPECT_LE(force_n, 3.3 * (n + 1) / 500 + 1e-9);
    EXPECT_GE(force_n, last_n);
    last_n = force_n;
  }
  rig.Tick(2);
  EXPECT_STATE(rig, kOn, kNone);
  EXPECT_NEAR((rig.Tick() - kPush_n).norm(), 0.0, 1e-9);
}

// --- Every cause, from a force that is on.

struct Cause {
  ForceState state;
  ForceReason reason;
  int ticks;  // to zero force
  std::function<void(SafetyInput&)> make;
};

const int kRampOut = RampOutTicks(SafetyLimits{}, kDtS);

std::vector<Cause> Causes() {
  using S = ForceState;
  using R = ForceReason;
  return {
      {S::kFault, R::kDevice, 0, [](SafetyInput& in) { in.device = DeviceStatus::kFault; }},
      {S::kFault, R::kPosition, 0, [](SafetyInput& in) { in.position_rejected = true; }},
      {S::kFault, R::kForce, 0, [](SafetyInput& in) { in.wrench_D.force_n.x() = kNan; }},
      {S::kFault, R::kForce, 0, [](SafetyInput& in) { in.wrench_D.force_n.z() = -kInfinity; }},
      {S::kFault, R::kSpeed, 0, [](SafetyInput& in) { in.p_DHip_mm.y() += 20.0; }},
      {S::kFault, R::kSpeed, 0, [](SafetyInput& in) { in.p_DHip_mm.y() = 1e308; }},
      {S::kHeld, R::kDocked, 0, [](SafetyInput& in) { in.docked = true; }},
      {S::kHeld, R::kUncalibrated, 0, [](SafetyInput& in) { in.calibrated = false; }},
      {S::kHeld, R::kStale, kRampOut, [](SafetyInput& in) { in.device = DeviceStatus::kStale; }},
      {S::kHeld, R::kDeadlines, kRampOut, [](SafetyInput& in) { in.missed_ticks = 30; }},
      {S::kOff, R::kOperator, kRampOut,
       [](SafetyInput& in) { in.command = ForceCommand::kDisable; }},
      {S::kStopped, R::kStopCall, 0, [](SafetyInput& in) { in.command = ForceCommand::kStop; }},
      {S::kStopped, R::kStopButton, 0, [](SafetyInput& in) { in.buttons = 3; }},
  };
}

TEST(Safety, EveryCauseReachesZeroInItsTicks) {
  for (const Cause& cause : Causes()) {
    SCOPED_TRACE(static_cast<int>(cause.reason));
    Rig rig = On();
    rig.input.wrench_D.force_n *= 100.0;
    EXPECT_GT(rig.Tick(20).norm(), 3.0);
    cause.make(rig.input);
    Vec3 force_n = rig.Tick();
    EXPECT_EQ(rig.safety.state(), cause.state);
    EXPECT_EQ(rig.safety.reason(), cause.reason);
    EXPECT_EQ(rig.safety.faulty(), cause.state == ForceState::kFault);
    if (cause.ticks > 0) {
      EXPECT_FALSE(force_n.isZero());
      force_n = rig.Tick(cause.ticks);
    }
    EXPECT_EQ(force_n, Vec3::Zero());
  }
}

// Forces come back by themselves, with a ramp, if the state is "held".
TEST(Safety, WhatIsHeldComesBackWithARamp) {
  for (const Cause& cause : Causes()) {
    if (cause.state != ForceState::kHeld) continue;
    SCOPED_TRACE(static_cast<int>(cause.reason));
    Rig rig = On();
    const SafetyInput usual = rig.input;
    cause.make(rig.input);
    rig.Tick(100);
    EXPECT_EQ(rig.safety.state(), ForceState::kHeld);
    rig.input = usual;
    for (int n = 0; n < 2000 && rig.safety.state() == ForceState::kHeld; ++n) rig.Tick();
    EXPECT_STATE(rig, kRampIn, kNone);
    EXPECT_LT(rig.Tick().norm(), 0.1);
    EXPECT_NEAR((rig.Settle() - kPush_n).norm(), 0.0, 1e-9);
    EXPECT_STATE(rig, kOn, kNone);
  }
}

// On hardware only the operator ends a fault or a stop. Enabling does not work while the cause is
// still there.
TEST(Safety, FaultsAndStopsStayUntilForcesAreEnabled) {
  for (const Cause& cause : Causes()) {
    if (cause.state == ForceState::kHeld) continue;
    SCOPED_TRACE(static_cast<int>(cause.reason));
    Rig rig = On();
    cause.make(rig.input);
    rig.Tick();
    if (cause.state == ForceState::kFault) {
      const SafetyInput still = rig.input;
      rig.input.command = ForceCommand::kEnable;
      if (cause.reason != ForceReason::kSpeed) {  // its hand is at rest again
        EXPECT_TRUE(rig.Tick().isZero());
        EXPECT_EQ(rig.safety.state(), ForceState::kFault);
      }
      rig.input = still;
    }
    rig.input.device = DeviceStatus::kOk;
    rig.input.position_rejected = false;
    rig.input.buttons = 0;
    rig.input.wrench_D.force_n = kPush_n;
    rig.input.p_DHip_mm = Vec3::Zero();
    EXPECT_TRUE(rig.Tick(1000).isZero() || cause.state == ForceState::kOff);
    EXPECT_TRUE(rig.Tick().isZero());
    EXPECT_EQ(rig.safety.state(), cause.state);
    rig.Tell(ForceCommand::kEnable);
    EXPECT_STATE(rig, kRampIn, kNone);
    EXPECT_NEAR((rig.Settle() - kPush_n).norm(), 0.0, 1e-9);
  }
}

TEST(Safety, EnablingWhatIsOnChangesNothing) {
  Rig rig = On();
  const Vec3 force_n = rig.Tick();
  EXPECT_EQ(rig.Tell(ForceCommand::kEnable), force_n);
  EXPECT_STATE(rig, kOn, kNone);
}

TEST(Safety, DisablingAndTheStopWorkInEveryStateAndAStopOutlastsFaults) {
  for (const Cause& cause : Causes()) {
    Rig off = On();
    cause.make(off.input);
    off.Tick();
    off.input.buttons = 0;
    Rig stopped = off;
    off.Tell(ForceCommand::kDisable);
    EXPECT_STATE(off, kOff, kOperator);
    EXPECT_TRUE(stopped.Tell(ForceCommand::kStop).isZero());
    EXPECT_STATE(stopped, kStopped, kStopCall);
    stopped.input.device = DeviceStatus::kFault;
    stopped.Tick();
    EXPECT_STATE(stopped, kStopped, kStopCall);
  }
  Rig rig(LimitsFor(Hardware(), 0));
  rig.Tell(ForceCommand::kEnable);
  rig.Tell(ForceCommand::kDisable);
  EXPECT_STATE(rig, kOff, kOperator);
}

TEST(Safety, HeldStopButtonsWinOverTheEnabling) {
  Rig rig = On();
  rig.input.buttons = 1;  // one of the two
  rig.Tick();
  EXPECT_STATE(rig, kOn, kNone);
  rig.input.buttons = 7;
  rig.Tell(ForceCommand::kEnable);
  EXPECT_STATE(rig, kStopped, kStopButton);
}

TEST(Safety, WithoutForcesThereAreNoFaultsOfForces) {
  for (const Cause& cause : Causes()) {
    if (cause.state != ForceState::kFault) continue;
    Rig rig(LimitsFor(Hardware(), 0));
    rig.Tick();
    cause.make(rig.input);
    EXPECT_TRUE(rig.Tick().isZero());
    EXPECT_STATE(rig, kOff, kOperator);
    // The tick is faulty all the same, except for a quick hand.
    EXPECT_EQ(rig.safety.faulty(), cause.reason != ForceReason::kSpeed);
  }
}

TEST(Safety, AFaultWhileRampingOutIsZeroAtOnce) {
  Rig rig = On();
  EXPECT_FALSE(rig.Tell(ForceCommand::kDisable).isZero());
  rig.input.device = DeviceStatus::kFault;
  EXPECT_TRUE(rig.Tick().isZero());
}

TEST(Safety, ASimulatedDeviceComesBackFromFaultsByItself) {
  for (const Cause& cause : Causes()) {
    if (cause.state != ForceState::kFault || cause.reason == ForceReason::kSpeed) continue;
    Rig rig = Simulated();
    rig.Settle();
    cause.make(rig.input);
    EXPECT_TRUE(rig.Tick().isZero());
    EXPECT_EQ(rig.safety.state(), ForceState::kFault);
    rig.input = {.wrench_D = {kPush_n}};
    EXPECT_NEAR(rig.Tick().norm(), 0.2, 1e-12);
    EXPECT_STATE(rig, kOn, kNone);
  }
  Rig rig = Simulated();
  rig.Tell(ForceCommand::kStop);
  EXPECT_TRUE(rig.Tick(100).isZero());
  rig.Tell(ForceCommand::kEnable);
  EXPECT_STATE(rig, kOn, kNone);
}

// After a replay, a dock or a held clutch, the stylus may rest deep inside.
TEST(Safety, AfterASuspensionTheForceComesBackByTheRampOnEveryDevice) {
  for (const bool docked : {false, true}) {
    for (Rig rig : {Simulated(), On()}) {
      rig.input.wrench_D.force_n = kPush_n / 3.0;  // the motors stay cool
      rig.Settle();
      rig.input.suspended = true;
      rig.input.docked = docked;
      rig.Tick(2);
      rig.input.suspended = rig.input.docked = false;
      double last_n = 0.0;
      for (int n = 0; n < 500; ++n) {
        const double force_n = rig.Tick().norm();
        ASSERT_LE(force_n, 3.3 * (n + 1) / 500 + 1e-9) << n;
        ASSERT_GE(force_n, last_n) << n;
        EXPECT_STATE(rig, kRampIn, kNone);
        last_n = force_n;
      }
      rig.Tick(2);
      EXPECT_STATE(rig, kOn, kNone);
      EXPECT_NEAR((rig.Tick() - kPush_n / 3.0).norm(), 0.0, 1e-9);
    }
  }
}

TEST(Safety, ASuspensionOfATickIsNoInterruption) {
  for (Rig rig : {Simulated(), On()}) {
    rig.Settle();
    rig.input.suspended = true;
    EXPECT_TRUE(rig.Tick().isZero());
    rig.input.suspended = false;
    EXPECT_NEAR(rig.Tick().norm(), 0.2, 1e-12);
    EXPECT_STATE(rig, kOn, kNone);
  }
}

TEST(Safety, ASuspensionWithinARampBeginsItAnew) {
  Rig rig(LimitsFor(Hardware(), 0));
  rig.Tell(ForceCommand::kEnable);
  rig.Tick(400);
  rig.input.suspended = true;
  rig.Tick(1000);
  EXPECT_FALSE(rig.safety.faulty());
  rig.input.suspended = false;
  EXPECT_LE(rig.Tick(10).norm(), 3.3 * 10 / 500 + 1e-9);
}

// --- The limits, one by one

TEST(Safety, LimitsOfADevice) {
  const SafetyLimits hardware = LimitsFor(Hardware(), 2);
  EXPECT_EQ(hardware.max_force_n, 3.3);
  EXPECT_EQ(hardware.continuous_force_n, 0.88);
  EXPECT_FALSE(hardware.starts_on);
  EXPECT_TRUE(hardware.faults_stay);
  EXPECT_GT(hardware.max_speed_mm_per_s, 0.0);
  EXPECT_EQ(hardware.stop_buttons, 2u);
  DeviceDescription simulated = Hardware();
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
  rig.input.wrench_D.force_n = Vec3(0, 0, 10);
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
  rig.input.wrench_D.force_n.setZero();
  rig.Tick(20'000);
  EXPECT_EQ(rig.safety.limit_n(), 3.3);
}

TEST(Safety, TheContinuousForceIsNeverShortened) {
  Rig rig = On();
  rig.input.wrench_D.force_n = Vec3(0.88, 0, 0);
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

void MissOneOf(int every, int from, int to, Rig& rig) {
  for (int n = from; n < to; ++n) {
    rig.input.missed_ticks = n % every == 0;
    rig.Tick();
  }
}

TEST(Safety, OneMissedTickOfTwentyIsNoCause) {
  Rig rig = On();
  MissOneOf(20, 0, 20'000, rig);
  EXPECT_STATE(rig, kOn, kNone);
  rig.input.missed_ticks = 15;  // the machine stopped
  rig.Tick();
  EXPECT_STATE(rig, kOn, kNone);
  MissOneOf(1, 0, 100, rig);
  EXPECT_STATE(rig, kHeld, kDeadlines);
}

// README: more than 20 missed ticks beyond 5 %. One missed tick in ten is 0.05 more per tick.
TEST(Safety, OneMissedTickOfTenIsACauseAfterFourHundred) {
  Rig rig = On();
  MissOneOf(10, 0, 350, rig);
  EXPECT_STATE(rig, kOn, kNone);
  MissOneOf(10, 350, 450, rig);
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

TEST(Safety, SuspendedTicksHaveNoForceAndAreNoFault) {
  Rig rig = On();
  rig.input.suspended = true;
  EXPECT_TRUE(rig.Tick().isZero());
  EXPECT_STATE(rig, kOn, kNone);
  EXPECT_FALSE(rig.safety.faulty());
}

// --- All at once

double RandomNumber(std::mt19937_64& random) {
  constexpr double kWild[] = {kNan, kInfinity, -kInfinity};
  const std::size_t n = random() % 8;
  if (n < std::size(kWild)) return kWild[n];
  if (n == 3) return std::bit_cast<double>(random());
  if (n == 4) return 1e308;
  return std::uniform_real_distribution<double>(-10.0, 10.0)(random);
}

TEST(Safety, AMillionRandomTicksKeepEveryLimit) {
  std::mt19937_64 random(20);
  SafetyLimits hardware = LimitsFor(Hardware(), 3);
  hardware.max_torque_n_mm = 50.0;
  hardware.max_turn_rad_per_s = 40.0;
  for (const SafetyLimits& limits : {hardware, SafetyLimits{}}) {
    Safety safety(limits);
    Vec3 last_n_mm = Vec3::Zero();
    Vec3 last_n = Vec3::Zero(), steady_n = kPush_n, p_mm = Vec3::Zero();
    int felt = 0, faults = 0;
    for (int n = 0; n < 1'000'000; ++n) {
      const auto one_of = [&](unsigned count) { return random() % count == 0; };
      SafetyInput input{.wrench_D = {steady_n, 20.0 * steady_n}, .p_DHip_mm = p_mm};
      if (one_of(5000)) {
        for (double& f : input.wrench_D.force_n) f = RandomNumber(random);
        for (double& t : input.wrench_D.torque_n_mm) t = RandomNumber(random);
      }
      if (one_of(9000)) {
        for (double& c : input.R_DS.coeffs()) c = RandomNumber(random);
      }
      if (one_of(50)) steady_n = 5.0 * Vec3::Random();
      p_mm += 0.3 * Vec3::Random();
      if (one_of(9000)) p_mm = 100.0 * Vec3::Random();
      if (one_of(9000)) {
        for (double& p : input.p_DHip_mm) p = RandomNumber(random);
        input.position_rejected = !input.p_DHip_mm.allFinite();
      }
      if (one_of(9000)) input.device = DeviceStatus::kStale;
      if (one_of(9000)) input.device = DeviceStatus::kFault;
      input.docked = one_of(9000);
      input.calibrated = !one_of(9000);
      input.suspended = one_of(9000);
      if (one_of(9000)) input.buttons = static_cast<std::uint32_t>(random());
      if (one_of(300)) input.command = ForceCommand::kEnable;
      if (one_of(5000)) input.command = ForceCommand::kDisable;
      if (one_of(5000)) input.command = ForceCommand::kStop;
      if (one_of(400)) input.missed_ticks = random() % 30;
      if (one_of(100'000)) input.missed_ticks = random();

      const auto [force_n, torque_n_mm] = safety.Step(input, kDtS);
      ASSERT_TRUE(force_n.allFinite());
      ASSERT_LE(force_n.norm(), 3.3 * (1 + 1e-12));
      const bool gradual = (force_n - last_n).norm() <= 0.2 * (1 + 1e-9);
      const ForceState state = safety.state();
      const bool cut = safety.faulty() || state == ForceState::kStopped || input.suspended ||
                       input.docked || !input.calibrated;
      ASSERT_TRUE(cut ? force_n.isZero() : gradual) << n;
      ASSERT_TRUE(std::isfinite(safety.limit_n()));
      ASSERT_LE(torque_n_mm.norm(), limits.max_torque_n_mm * (1 + 1e-12));
      ASSERT_LE((torque_n_mm - (cut ? torque_n_mm : last_n_mm)).norm(), 3.0 * (1 + 1e-9));
      ASSERT_TRUE(!cut || torque_n_mm.isZero()) << n;
      last_n_mm = torque_n_mm;
      last_n = force_n;
      felt += !force_n.isZero();
      faults += state == ForceState::kFault;
    }
    EXPECT_GT(felt, 300'000);
    EXPECT_GT(faults, 200);
  }
}

TEST(Safety, GoesOnFromItsMemory) {
  std::mt19937_64 random(3);
  DeviceDescription spec = Hardware();
  spec.max_torque_n_mm = 50.0;
  spec.continuous_torque_n_mm = 12.0;
  const SafetyLimits limits = LimitsFor(spec, 0);
  Safety one(limits), other(limits);
  for (int n = 0; n < 20'000; ++n) {
    SafetyInput input{.wrench_D = {Vec3::Random() * 5.0, Vec3::Random() * 60.0},
                      .p_DHip_mm = Vec3::Random(),
                      .R_DS = Eigen::Quaterniond(1.0, 0.01 * std::sin(n), 0.0, 0.0).normalized()};
    if (n % 1000 == 0) input.command = ForceCommand::kEnable;
    if (random() % 3000 == 0) input.device = DeviceStatus::kFault;
    input.missed_ticks = random() % 100 == 0;
    const Wrench wrench = one.Step(input, kDtS);
    const Wrench again = other.Step(input, kDtS);
    ASSERT_EQ(again.force_n, wrench.force_n);
    ASSERT_EQ(again.torque_n_mm, wrench.torque_n_mm);
    if (n % 777 == 0) {
      Safety fresh(limits);
      fresh.Resume(one.memory());
      other = fresh;
    }
  }
}

}  // namespace
}  // namespace palpate
