// What must be before a device of Force Dimension gets force: power, calibration, by hand or by an
// arm that moves by itself, and its watchdog. The library is one of our own.
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <string>

#include "tests/support/forcedimension_rig.h"
#include "tests/support/refusal.h"

namespace palpate::test {
namespace forcedimension {

// No force, and its motors stay off, until it is as it must be.
TEST_F(ForceDimensionTest, WithoutCalibrationPowerOrWatchdogThereIsNoForce) {
  const struct {
    std::function<void(bool wrong)> make;
    std::string part;
  } cases[] = {
      {[&](bool wrong) { fake().initialized = !wrong; }, "device calibrate forcedimension"},
      {[&](bool wrong) { fake().is_reset = wrong; }, "device calibrate forcedimension"},
      {[&](bool wrong) { fake().powered = !wrong; }, "power supply"}};
  for (const auto& one : cases) {
    one.make(true);
    Make();
    ASSERT_TRUE(device_->Streams());
    const int enabled = fake().enable_ons;
    EXPECT_TRUE(device_->Logs(one.part, kPush)) << device_->log();
    EXPECT_TRUE(device_->HasProblem(one.part));
    EXPECT_FALSE(device_->state().calibrated);
    EXPECT_EQ(fake().enable_ons, enabled);
    one.make(false);
    EXPECT_TRUE(Pushes());
    one.make(true);
    EXPECT_TRUE(device_->Serve(kPush, [&] { return !fake().forces_enabled; }));
    one.make(false);
    EXPECT_TRUE(Pushes());
  }
  const auto no_watchdog = {std::function<void()>([&] { fake().watchdog_settable = false; }),
                            std::function<void()>([&] {
                              fake().watchdog_settable = true;
                              fake().watchdog_reads_back = 0;
                            })};
  for (const std::function<void()>& change : no_watchdog) {
    fake().watchdog_steps = 0;
    change();
    Make();
    ASSERT_TRUE(device_->Streams());
    const int enabled = fake().enable_ons;
    EXPECT_TRUE(device_->Logs("forcedimension_without_watchdog", kPush));
    EXPECT_EQ(fake().enable_ons, enabled);
    Make({.model = kSigma, .without_watchdog = true});
    EXPECT_TRUE(PushesSoon());
  }
}

TEST_F(ForceDimensionTest, AnArmMovesByItselfOnlyWithForcesOffAndAfterAWarning) {
  fake().initialized = false;
  fake().auto_init_ms = 300;
  Make();
  ASSERT_TRUE(device_->Streams());
  EXPECT_TRUE(device_->HasProblem("palpate device calibrate forcedimension"));
  const auto asked = std::chrono::steady_clock::now();
  (*device_)->Calibrate();
  EXPECT_TRUE(device_->Logs("moves by itself in 3 s"));
  EXPECT_TRUE(device_->HasProblem("keep clear"));
  ASSERT_TRUE(Eventually([&] { return fake().in_auto_init.load(); }));
  EXPECT_GE(std::chrono::steady_clock::now() - asked, std::chrono::seconds(3));
  using palpate::testing::Refusal;
  EXPECT_EQ(Refusal([&] { (*device_)->Calibrate(); }), ErrorKind::kConflict);
  EXPECT_TRUE(device_->Logs("has calibrated itself"));
  EXPECT_FALSE(fake().forces_enabled);  // the library left them on
  EXPECT_TRUE(Pushes());
  EXPECT_EQ(fake().auto_inits, 1);
  EXPECT_EQ(fake().drd_stops, 1);
  EXPECT_EQ(device_->health().connections, 1u);
  (*device_)->Calibrate();
  EXPECT_TRUE(device_->Logs("forces are on", kPush));
  EXPECT_EQ(fake().auto_inits, 1);
  EXPECT_TRUE(Eventually([&] { return !fake().forces_enabled; }));

  fake().auto_init_result = -1;
  fake().initialized = false;
  EXPECT_TRUE(device_->HasProblem("device calibrate forcedimension"));
  (*device_)->Calibrate();
  EXPECT_TRUE(device_->Logs("could not calibrate itself: error 12"));
  EXPECT_FALSE(fake().forces_enabled);
  EXPECT_EQ(fake().auto_inits, 2);
}

TEST_F(ForceDimensionTest, AnArmDoesNotMoveByItselfWithoutPowerOrWatchdog) {
  fake().initialized = false;
  fake().watchdog_settable = false;
  Make();
  ASSERT_TRUE(device_->Streams());
  (*device_)->Calibrate();
  EXPECT_TRUE(device_->Logs("does not move: no forces"));
  fake().watchdog_settable = true;
  Make();
  ASSERT_TRUE(device_->Streams());
  fake().powered = false;
  (*device_)->Calibrate();
  EXPECT_TRUE(device_->Logs("does not move: no power"));
  EXPECT_EQ(fake().auto_inits, 0);
}

TEST_F(ForceDimensionTest, ADeviceThatLostItsSettingsIsSetUpAnew) {
  Make();
  ASSERT_TRUE(PushesSoon());
  fake().powered = false;
  ExpectLost("power supply", [&] {
    fake().watchdog_steps = 0;
    fake().powered = true;
  });
  EXPECT_EQ(fake().watchdog_steps, 160);
  EXPECT_TRUE(Eventually([&] { return !fake().forces_enabled; }));
  fake().powered = false;
  EXPECT_TRUE(device_->HasProblem("power supply"));
  fake().watchdog_steps = 0;
  fake().powered = true;
  EXPECT_TRUE(device_->Logs("lost its settings"));
  EXPECT_TRUE(Pushes());
  EXPECT_EQ(fake().watchdog_steps, 160);
}

// Somebody stops it before and while it moves; and palpated ends.
TEST_F(ForceDimensionTest, AnArmThatMovesByItselfCanBeStopped) {
  fake().initialized = false;
  fake().auto_init_ms = 60'000;
  Make();
  ASSERT_TRUE(device_->Streams());
  (*device_)->Calibrate();
  EXPECT_TRUE(device_->Logs("moves by itself in 3 s"));
  (*device_)->StopMoving();
  EXPECT_TRUE(device_->Logs("it was stopped"));
  EXPECT_EQ(fake().auto_inits, 0);
  device_->Forget();
  (*device_)->Calibrate();
  ASSERT_TRUE(Eventually([&] { return fake().in_auto_init.load(); }));
  (*device_)->StopMoving();
  EXPECT_TRUE(Eventually([&] { return !fake().in_auto_init; }));
  EXPECT_TRUE(device_->Logs("it was stopped"));
  EXPECT_FALSE(fake().forces_enabled);
  // By its button: the servo gets no reading meanwhile.
  device_->Forget();
  (*device_)->Calibrate();
  EXPECT_TRUE((*device_)->moves_by_itself());
  ASSERT_TRUE(Eventually([&] { return fake().in_auto_init.load(); }));
  fake().buttons = 1;
  EXPECT_TRUE(Eventually([&] { return !fake().in_auto_init; }));
  EXPECT_TRUE(device_->Logs("it was stopped"));
  EXPECT_FALSE((*device_)->moves_by_itself());
  fake().buttons = 0;
  (*device_)->Calibrate();
  ASSERT_TRUE(Eventually([&] { return fake().in_auto_init.load(); }));
  (*device_)->Stop();
  EXPECT_FALSE(fake().in_auto_init);
  EXPECT_FALSE(fake().opened);
}

TEST_F(ForceDimensionTest, AnOmegaIsCalibratedByHandAndItsGripperMayBeAButton) {
  Be("omega.7", true, false, true);
  Make({.model = "omega.7", .gripper_button = true});
  ASSERT_TRUE(device_->Streams());
  EXPECT_TRUE(fake().emulates_button);
  EXPECT_EQ(palpate::testing::Refusal([&] { (*device_)->Calibrate(); }),
            ErrorKind::kInvalidArgument);
  fake().buttons = 7;  // what the others are is not written
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return device_->state().buttons == 1; }));
}

}  // namespace forcedimension
}  // namespace palpate::test
