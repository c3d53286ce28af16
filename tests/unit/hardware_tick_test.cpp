// Ticks of a device with motors: when there is force, and when it is not let near them.
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <thread>

#include "server/servo/servo_tick.h"
#include "tests/support/patience.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

// A sphere, touched from above.
class HardwareTick : public ::testing::Test {
 protected:
  HardwareTick() {
    // From outside: a proxy inside would be ejected.
    for (double z = 14.0; z > 10.0; z -= 0.1) {
      device_.reading.p_DHip_mm.z() = z;
      Tick();
    }
  }

  TickSample Tick(int count = 1) {
    TickSample sample;
    for (int n = 0; n < count; ++n) {
      sample = tick_.Run(scene_, {++ticks_, ticks_, 0});
      EXPECT_EQ(device_.written_D_n, Vec3(sample.force_n.data()));
      EXPECT_TRUE(device_.motors_on || device_.written_D_n.isZero());
    }
    return sample;
  }
  double Force(int count = 1) { return Vec3(Tick(count).force_n.data()).norm(); }

  testing::FakeDevice device_{VerificationLevel::kNone};
  const Scene scene_ = testing::SphereScene();
  ForceSwitch forces_;
  ServoTick tick_{device_, LimitsFor(device_.spec(), 3), &forces_};
  std::int64_t ticks_ = 0;
};

TEST_F(HardwareTick, NoForceAndNoCurrentUntilForcesAreEnabled) {
  const TickSample before = Tick(1000);
  EXPECT_TRUE(before.contact);
  EXPECT_EQ(before.force_state, ForceState::kOff);
  EXPECT_EQ(before.mode, TickMode::kConstrained);
  EXPECT_EQ(Force(), 0.0);
  EXPECT_FALSE(device_.motors_on);
  forces_.Set(ForceCommand::kEnable);
  EXPECT_LT(Force(), 0.01);
  EXPECT_TRUE(device_.motors_on);
  EXPECT_GT(Force(600), 0.5);
}

TEST_F(HardwareTick, ADockedOrUncalibratedStylusFeelsNothing) {
  forces_.Set(ForceCommand::kEnable);
  EXPECT_GT(Force(600), 0.5);
  for (bool DeviceState::*member : {&DeviceState::docked, &DeviceState::calibrated}) {
    device_.reading.*member = !(device_.reading.*member);
    const TickSample sample = Tick();
    EXPECT_EQ(sample.mode, TickMode::kSuspended);
    EXPECT_EQ(sample.force_state, ForceState::kHeld);
    EXPECT_TRUE(device_.written_D_n.isZero());
    EXPECT_FALSE(device_.motors_on);
    device_.reading.*member = !(device_.reading.*member);
    EXPECT_LT(Force(), 0.01);
    // The proxy has begun anew, inside: it is brought out.
    Tick(600);
    EXPECT_EQ(Tick().force_state, ForceState::kOn);
  }
}

TEST_F(HardwareTick, AFaultStaysAndTheLoopGoesOn) {
  forces_.Set(ForceCommand::kEnable);
  Tick(600);
  device_.status = DeviceStatus::kFault;
  EXPECT_EQ(Force(), 0.0);
  EXPECT_FALSE(device_.motors_on);
  EXPECT_EQ(Tick(500).mode, TickMode::kFault);
  device_.status = DeviceStatus::kOk;
  EXPECT_EQ(Force(1000), 0.0);
  EXPECT_EQ(Tick().force_reason, ForceReason::kDevice);
  forces_.Set(ForceCommand::kEnable);
  Tick();
  EXPECT_EQ(Tick().force_state, ForceState::kRampIn);
}

TEST_F(HardwareTick, BothButtonsStop) {
  forces_.Set(ForceCommand::kEnable);
  EXPECT_GT(Force(600), 0.5);
  device_.reading.buttons = 3;
  EXPECT_EQ(Force(), 0.0);
  device_.reading.buttons = 0;
  const TickSample sample = Tick(1000);
  EXPECT_EQ(sample.force_state, ForceState::kStopped);
  EXPECT_EQ(sample.force_reason, ForceReason::kStopButton);
}

TEST_F(HardwareTick, ComputedAgainFromTheirSamplesTicksAreTheSame) {
  TickComputation again(LimitsFor(device_.spec(), 3));
  ASSERT_TRUE(again.Resume(tick_.Keyframe().view()));
  for (int n = 0; n < 3000; ++n) {
    if (n == 10 || n == 2000) forces_.Set(ForceCommand::kEnable);
    if (n == 2500) forces_.Set(ForceCommand::kDisable);
    device_.status = n > 900 && n < 930     ? DeviceStatus::kStale
                     : n > 1500 && n < 1530 ? DeviceStatus::kFault
                                            : DeviceStatus::kOk;
    device_.reading.docked = n > 1000 && n < 1100;
    device_.reading.buttons = n == 2700 ? 3 : 0;
    const TickSample sample = Tick();
    const TickSample same = again.Run(scene_, again.InputOf(sample));
    ASSERT_EQ(same.force_n, sample.force_n) << n;
    ASSERT_EQ(same.force_state, sample.force_state) << n;
    ASSERT_EQ(same.force_reason, sample.force_reason) << n;
    ASSERT_EQ(same.mode, sample.mode) << n;
    ASSERT_EQ(same.force_limit_n, sample.force_limit_n) << n;
  }
  EXPECT_EQ(again.Keyframe().view(), tick_.Keyframe().view());
}

TEST(ForceSwitch, TheNewestCommandIsTakenOnce) {
  ForceSwitch forces;
  EXPECT_EQ(forces.Take(), ForceCommand::kNone);
  forces.Set(ForceCommand::kEnable);
  forces.Set(ForceCommand::kDisable);
  EXPECT_EQ(forces.Take(), ForceCommand::kDisable);
  EXPECT_EQ(forces.Take(), ForceCommand::kNone);
}

TEST(ForceSwitch, AStopIsNeverLost) {
  ForceSwitch forces;
  std::atomic<bool> end{false};
  std::thread others[2];
  for (auto& thread : others) {
    thread = std::thread([&] {
      while (!end) forces.Set(ForceCommand::kEnable);
    });
  }
  for (int n = 0; n < 500; ++n) {
    std::thread stopper([&] { forces.Set(ForceCommand::kStop); });
    EXPECT_TRUE(test::Eventually([&] { return forces.Take() == ForceCommand::kStop; })) << n;
    stopper.join();
  }
  end = true;
  for (auto& thread : others) thread.join();
}

}  // namespace
}  // namespace palpate
