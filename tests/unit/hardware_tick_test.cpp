// Ticks of a device with motors: when there is force, and when it is not let near them.
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
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

// safety_test.cpp has how the forces come back.
TEST_F(HardwareTick, WhatTheDeviceSaysIsHeededInItsTick) {
  struct Case {
    std::function<void(testing::FakeDevice&)> say;
    TickMode mode;
    ForceState state;
    ForceReason reason;
  };
  const Case cases[] = {{[](auto& device) { device.reading.docked = true; }, TickMode::kSuspended,
                         ForceState::kHeld, ForceReason::kDocked},
                        {[](auto& device) { device.reading.calibrated = false; },
                         TickMode::kSuspended, ForceState::kHeld, ForceReason::kUncalibrated},
                        {[](auto& device) { device.status = DeviceStatus::kFault; },
                         TickMode::kFault, ForceState::kFault, ForceReason::kDevice},
                        {[](auto& device) { device.reading.buttons = 3; }, TickMode::kConstrained,
                         ForceState::kStopped, ForceReason::kStopButton}};
  const DeviceState usual = device_.reading;
  for (const Case& c : cases) {
    SCOPED_TRACE(static_cast<int>(c.reason));
    forces_.Set(ForceCommand::kEnable);
    EXPECT_GT(Force(600), 0.5);
    c.say(device_);
    for (int n = 0; n < 500; ++n) {
      const TickSample sample = Tick();
      ASSERT_EQ(sample.mode, c.mode);
      ASSERT_EQ(sample.force_state, c.state);
      ASSERT_EQ(sample.force_reason, c.reason);
      ASSERT_TRUE(device_.written_D_n.isZero());
      ASSERT_FALSE(device_.motors_on);
    }
    device_.reading = usual;
    device_.status = DeviceStatus::kOk;
    EXPECT_LT(Force(), 0.01);
  }
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
