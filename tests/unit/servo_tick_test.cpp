// Ticks of a device with motors: when there is force, and when it is not let near them. Ticks in
// which nothing is felt, and the first ones after them: bad readings, missed ticks, resumes inside
// the material. passivity_surface_test.cpp has the energy of a resume.
#include "server/servo/servo_tick.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <random>
#include <thread>
#include <vector>

#include "tests/support/patience.h"
#include "tests/support/recording.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

// Above a sphere.
class Ticking : public ::testing::Test {
 protected:
  Ticking(VerificationLevel level, std::uint32_t stop_buttons)
      : device_(level),
        tick_(device_, LimitsFor(device_.spec(), stop_buttons), &forces_, &pushes_) {}

  TickSample Tick(std::uint64_t missed_more = 0) {
    missed_ += missed_more;
    const std::int64_t now_ns = 1'000'000 * ++ticks_;
    const TickSample sample = tick_.Run(scene_, {now_ns, now_ns, missed_});
    EXPECT_EQ(device_.written.wrench_M.force_n, Vec3(sample.force_n.data()));
    // A point has no torque, whatever the device could do.
    EXPECT_EQ(device_.written.wrench_M.torque_n_mm, Vec3::Zero());
    EXPECT_EQ(Vec3(sample.torque_n_mm.data()), Vec3::Zero());
    EXPECT_EQ(sample.torque_limit_n_mm, 50.0);
    EXPECT_TRUE(device_.written.motors_on || device_.written.wrench_M.force_n.isZero());
    return sample;
  }
  TickSample TickAt(const Vec3& p_mm) {
    device_.reading.p_MHip_mm = p_mm;
    return Tick();
  }

  testing::FakeDevice device_;
  Scene scene_ = testing::SphereScene();
  ForceSwitch forces_;
  HandPush pushes_;
  ServoTick tick_;
  std::int64_t ticks_ = 0;
  std::uint64_t missed_ = 0;
};

class HardwareTick : public Ticking {
 protected:
  HardwareTick() : Ticking(VerificationLevel::kNone, 3) {
    // From outside: a proxy inside would be ejected.
    for (double z = 14.0; z > 10.0; z -= 0.1) TickAt(Vec3(0, 0, z));
  }

  double Force(int count = 1) {
    for (int n = 1; n < count; ++n) Tick();
    return Vec3(Tick().force_n.data()).norm();
  }
};

TEST_F(HardwareTick, NoForceAndNoCurrentUntilForcesAreEnabled) {
  Force(999);
  const TickSample before = Tick();
  EXPECT_TRUE(before.contact);
  EXPECT_EQ(before.force_state, ForceState::kOff);
  EXPECT_EQ(before.mode, ProxyMode::kConstrained);
  EXPECT_EQ(Force(), 0.0);
  EXPECT_FALSE(device_.written.motors_on);
  forces_.Set(ForceCommand::kEnable);
  EXPECT_LT(Force(), 0.01);
  EXPECT_TRUE(device_.written.motors_on);
  EXPECT_GT(Force(600), 0.5);
}

// Two callers, three minutes; the window is summed up anew.
TEST(HandPush, OfAnyTenSecondsPushesTakeFive) {
  std::mt19937 random(7);
  const auto below = [&](int limit) { return static_cast<int>(random() % limit); };
  HandPush pushes;
  std::vector<int> pushed;  // for each ms
  while (pushed.size() < 180'000) {
    const double most_n = below(5) == 0 ? 5.0 : 0.5;
    if (below(50) == 0) pushes.Push(Vec3(0, most_n * (below(2) - 0.5) * 2.0, 0), 1 + below(6000));
    const int missed = below(100) == 0 ? below(30) : 0;
    pushed.insert(pushed.end(), missed, pushed.empty() ? 0 : pushed.back());
    const Vec3 force_n = pushes.Next(below(5000) != 0, missed);
    const bool acts = !std::isnan(force_n.x());
    if (acts) {
      EXPECT_LE(force_n.norm(), 0.5);
    }
    pushed.push_back(acts);
  }
  int in_window = 0, most = 0, pushed_ms = 0;
  for (std::size_t ms = 0; ms < pushed.size(); ++ms) {
    pushed_ms += pushed[ms];
    in_window += pushed[ms] - (ms < 10'000 ? 0 : pushed[ms - 10'000]);
    most = std::max(most, in_window);
  }
  EXPECT_LE(most, 5000 + 30);  // it was pushed in the ticks that were missed
  EXPECT_GT(pushed_ms, 60'000);
}

TEST_F(HardwareTick, APushIsAllThatIsFeltForItsTicksAndIsReplayed) {
  pushes_.Push(Vec3(0, 0.3, 0), 100);  // forces are off: it is dropped
  EXPECT_EQ(Force(), 0.0);
  forces_.Set(ForceCommand::kEnable);
  EXPECT_GT(Force(600), 0.5);
  const ServoKeyframe before = tick_.Keyframe();
  std::vector<TickSample> samples;
  pushes_.Push(Vec3(0, 0.3, 0), 100);
  for (int n = 0; n < 200; ++n) samples.push_back(Tick());
  EXPECT_EQ(Vec3(samples[50].force_n.data()), Vec3(0, 0.3, 0));
  EXPECT_EQ(samples[50].mode, ProxyMode::kSuspended);
  EXPECT_TRUE(samples[99].is_pushed());
  EXPECT_FALSE(samples[100].is_pushed());
  EXPECT_EQ(samples[100].force_state, ForceState::kRampIn);  // what is felt comes by a ramp

  TickComputation again(LimitsFor(device_.spec(), 3), PassivityDeviceOf(device_.spec()));
  ASSERT_TRUE(again.Resume(before.view()));
  for (TickSample& sample : samples) {
    const TickSample computed = again.Run(scene_, again.InputOf(sample));
    sample.update_ns = sample.time_ns = 0;
    ASSERT_TRUE(testing::SameSample(computed, sample)) << sample.tick;
  }

  // A clutch ends it, and what follows comes by a ramp.
  scene_.forces_off = true;
  pushes_.Push(Vec3(0, 0.3, 0), 100);
  Force(10);
  scene_.forces_off = false;
  EXPECT_LT(Force(), 0.05);
  EXPECT_FALSE(Tick().is_pushed());
  EXPECT_EQ(Tick().force_state, ForceState::kRampIn);
  Force(600);

  pushes_.Push(Vec3(0, 0.3, 0), 100);
  Tick();
  forces_.Set(ForceCommand::kStop);
  EXPECT_EQ(Force(), 0.0);
  forces_.Set(ForceCommand::kEnable);
  Force(20);
  EXPECT_FALSE(Tick().is_pushed());  // it does not come back
}

TEST_F(HardwareTick, AnotherRefinementWaitsUntilTheHandIsFree) {
  forces_.Set(ForceCommand::kEnable);
  Force(600);
  const TickSample before = Tick();
  ASSERT_TRUE(before.contact);
  scene_.surface.Refine(3);
  const TickSample waiting = Tick();
  EXPECT_EQ(waiting.refinement, 1u);
  EXPECT_EQ(waiting.scp_h_mm, before.scp_h_mm);
  EXPECT_EQ(waiting.force_n, before.force_n);
  TickAt(Vec3(0, 0, 13));
  EXPECT_EQ(Tick().refinement, 3u);
  EXPECT_EQ(TickAt(Vec3(0, 0, 11)).refinement, 3u);
  EXPECT_NEAR(Tick().scp_h_mm[2], before.scp_h_mm[2], 0.01);
}

// safety_test.cpp has how the forces come back.
TEST_F(HardwareTick, WhatTheDeviceSaysIsHeededInItsTick) {
  struct Case {
    std::function<void(testing::FakeDevice&)> say;
    ProxyMode mode;
    ForceState state;
    ForceReason reason;
  };
  const Case cases[] = {{[](auto& device) { device.reading.docked = true; }, ProxyMode::kSuspended,
                         ForceState::kHeld, ForceReason::kDocked},
                        {[](auto& device) { device.reading.calibrated = false; },
                         ProxyMode::kSuspended, ForceState::kHeld, ForceReason::kUncalibrated},
                        {[](auto& device) { device.status = DeviceStatus::kFault; },
                         ProxyMode::kFault, ForceState::kFault, ForceReason::kDevice},
                        {[](auto& device) { device.reading.buttons = 3; }, ProxyMode::kConstrained,
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
      ASSERT_TRUE(device_.written.wrench_M.force_n.isZero());
      ASSERT_FALSE(device_.written.motors_on);
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

// --- Suspended

class SuspendedTest : public Ticking {
 protected:
  SuspendedTest() : Ticking(VerificationLevel::kSimulated, 0) {
    scene_.settings.clutch_tool = true;
    device_.reading.p_MHip_mm = Vec3(0, 0, 20);
  }

  void Clutch(bool held) { device_.reading.buttons = held ? kClutchButton : 0; }
  static Vec3 ForceOf(const TickSample& sample) { return Vec3(sample.force_n.data()); }
};

TEST_F(SuspendedTest, TheForceIsZeroInTheVeryTickOfThePress) {
  for (int n = 0; n < 100; ++n) TickAt(Vec3(0, 0, 10));
  EXPECT_GT(ForceOf(Tick()).norm(), 0.5);
  Clutch(true);
  const TickSample sample = Tick();
  EXPECT_EQ(sample.mode, ProxyMode::kSuspended);
  EXPECT_EQ(sample.force_state, ForceState::kOn);
  EXPECT_EQ(ForceOf(sample), Vec3::Zero());
  EXPECT_EQ(sample.scp_h_mm, sample.hip_mm);
  EXPECT_FALSE(sample.contact);
  EXPECT_EQ(sample.surface_place.vertex_count, 0);
  EXPECT_FALSE(sample.input_rejected);
  EXPECT_EQ(sample.faulty_ticks, 0u);
}

TEST_F(SuspendedTest, AResumeInContactRampsTheForceIn) {
  for (int n = 0; n < 100; ++n) TickAt(Vec3(0, 0, 10));
  const Vec3 before_n = ForceOf(Tick());
  Clutch(true);
  for (int n = 0; n < 100; ++n) Tick();
  Clutch(false);
  for (int n = 1; n <= 500; ++n) {
    const TickSample sample = Tick();
    EXPECT_EQ(sample.force_state, ForceState::kRampIn) << n;
    EXPECT_LE(ForceOf(sample).norm(), 3.3 * n / 500 + 1e-9) << n;
  }
  Tick();
  EXPECT_LT((ForceOf(Tick()) - before_n).norm(), 1e-9);
}

TEST_F(SuspendedTest, TheFirstTickEverMayBeSuspended) {
  for (const bool by_scene : {false, true}) {
    ServoTick fresh(device_);
    Clutch(!by_scene);
    scene_.forces_off = by_scene;
    const TickSample sample = fresh.Run(scene_, {1, 1, 0});
    EXPECT_EQ(sample.mode, ProxyMode::kSuspended);
    EXPECT_EQ(sample.hip_mm[2], 20.0);
    EXPECT_EQ(ForceOf(sample), Vec3::Zero());
    Clutch(false);
    scene_.forces_off = false;
    scene_.settings.viscosity_n_s_per_m = 5.0;
    EXPECT_EQ(ForceOf(fresh.Run(scene_, {2, 2, 0})), Vec3::Zero());  // at rest
  }
}

TEST_F(SuspendedTest, TheFirstTickEverMayBeSuspendedWithoutAPosition) {
  Clutch(true);
  device_.reading.p_MHip_mm = Vec3(std::nan(""), 0, 0);
  for (int n = 0; n < 3; ++n) {
    const TickSample sample = Tick();
    EXPECT_EQ(sample.mode, ProxyMode::kFault);
    EXPECT_TRUE(sample.input_rejected);
    EXPECT_EQ(sample.hip_mm, (std::array<double, 3>{}));
    EXPECT_EQ(ForceOf(sample), Vec3::Zero());
  }
  EXPECT_EQ(Tick().faulty_ticks, 4u);
  // What comes first is no motion.
  scene_.settings.viscosity_n_s_per_m = 5.0;
  Clutch(false);
  EXPECT_EQ(ForceOf(TickAt(Vec3(0, 0, 20))), Vec3::Zero());
}

TEST_F(SuspendedTest, BadPositionsAreFaultsAndTheLastGoodOneStays) {
  TickAt(Vec3(1, 2, 20));
  Clutch(true);
  TickAt(Vec3(3, 2, 20));
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL, 1e7}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vec3 p_mm(9, 9, 9);
      p_mm[axis] = bad;
      const TickSample sample = TickAt(p_mm);
      EXPECT_EQ(sample.mode, ProxyMode::kFault);
      EXPECT_TRUE(sample.input_rejected);
      EXPECT_EQ(sample.hip_mm, (std::array<double, 3>{3, 2, 20}));
      EXPECT_EQ(sample.scp_h_mm, sample.hip_mm);
      EXPECT_EQ(ForceOf(sample), Vec3::Zero());
    }
  }
  EXPECT_EQ(TickAt(Vec3(3, 2, 20)).mode, ProxyMode::kSuspended);
}

TEST_F(SuspendedTest, ADeviceThatFailsIsAFaultToo) {
  Clutch(true);
  Tick();
  device_.status = DeviceStatus::kFault;
  TickSample sample = Tick();
  EXPECT_EQ(sample.mode, ProxyMode::kFault);
  EXPECT_EQ(ForceOf(sample), Vec3::Zero());
  // A late reading is none: forces are held, and come back by themselves.
  device_.status = DeviceStatus::kStale;
  sample = Tick();
  EXPECT_EQ(sample.mode, ProxyMode::kSuspended);
  EXPECT_EQ(sample.force_state, ForceState::kHeld);
  EXPECT_EQ(ForceOf(sample), Vec3::Zero());
  device_.status = DeviceStatus::kOk;
  EXPECT_EQ(Tick().mode, ProxyMode::kSuspended);
}

// Half a second at a steady speed, with gaps in the readings and missed ticks while
// nothing is felt: drag afterwards is that of this speed.
TEST_F(SuspendedTest, TheVelocityGoesOnWhileNothingIsFelt) {
  scene_.settings.viscosity_n_s_per_m = 2.0;
  const double speed_mm_per_s = 100.0;
  const Vec3 drag_n(-2e-3 * speed_mm_per_s, 0, 0);
  double x_mm = -30.0;
  const auto tick = [&](std::uint64_t missed, bool bad) {
    x_mm += speed_mm_per_s * 1e-3 * static_cast<double>(1 + missed);
    device_.reading.p_MHip_mm = bad ? Vec3::Constant(std::nan("")) : Vec3(x_mm, 0, 20);
    return ForceOf(Tick(missed));
  };
  for (int n = 0; n < 100; ++n) tick(0, false);
  EXPECT_LT((tick(0, false) - drag_n).norm(), 1e-6);
  Clutch(true);
  for (int n = 0; n < 100; ++n) {
    const bool bad = n % 10 > 2;
    EXPECT_EQ(tick(n % 7 == 0 ? 3 : 0, bad), Vec3::Zero());
  }
  tick(0, false);
  Clutch(false);
  for (int n = 0; n < 40; ++n) {  // the ramp has passed this force
    const Vec3 force_n = tick(0, false);
    EXPECT_LE(force_n.norm(), drag_n.norm() + 1e-6) << n;
  }
  EXPECT_LT((tick(0, false) - drag_n).norm(), 1e-6);
}

// The stylus was carried through the volume: the way is not pushed back along, and
// neither friction nor a pop of before is left.
TEST_F(SuspendedTest, NothingOfBeforeIsFeltAfterwards) {
  scene_.settings.static_friction = scene_.settings.dynamic_friction = 1.0;
  for (int n = 0; n < 50; ++n) TickAt(Vec3(0, 0, 14 - 0.1 * n));
  for (int n = 0; n < 50; ++n) TickAt(Vec3(0.05 * n, 0, 9));
  Clutch(true);
  for (int n = 0; n < 50; ++n) TickAt(Vec3(0, 0, 9 - 0.5 * n));
  EXPECT_EQ(Tick().hip_mm[2], -15.5);
  Clutch(false);
  const TickSample sample = Tick();
  EXPECT_EQ(sample.mode, ProxyMode::kFree);
  EXPECT_EQ(ForceOf(sample), Vec3::Zero());
  EXPECT_EQ(sample.scp_h_mm, sample.hip_mm);
}

TEST_F(SuspendedTest, APopOfBeforeIsForgotten) {
  scene_.settings.pop_force_n = 1.0;
  for (int n = 0; n < 100; ++n) TickAt(Vec3(0, 0, 14 - 0.1 * n));
  EXPECT_EQ(Tick().free_side, FreeSide::kAbove);  // popped
  Clutch(true);
  EXPECT_EQ(Tick().free_side, FreeSide::kBelow);
  for (int n = 0; n < 10; ++n) TickAt(Vec3(0, 0, 20));
  Clutch(false);
  const TickSample sample = Tick();
  EXPECT_EQ(sample.free_side, FreeSide::kBelow);
  EXPECT_EQ(ForceOf(sample), Vec3::Zero());
}

TEST_F(SuspendedTest, AResumeAtAnyDepthKeepsTheSlewAndTheLimit) {
  for (const bool passivity : {false, true}) {
    for (const double stiffness : {0.0, 0.5, 3.0}) {
      for (double z_mm = 11.9; z_mm > -12.0; z_mm -= 1.7) {
        scene_.settings.passivity_control = passivity;
        scene_.settings.stiffness_n_per_mm = stiffness;
        Clutch(true);
        TickAt(Vec3(0.3, 0.2, z_mm));
        Clutch(false);
        Vec3 last_n = Vec3::Zero();
        for (int n = 0; n < 200; ++n) {
          const TickSample sample = Tick();
          EXPECT_LE((ForceOf(sample) - last_n).norm(), testing::kMaxStepN);
          EXPECT_LE(ForceOf(sample).norm(), 3.3 + 1e-9);
          last_n = ForceOf(sample);
          if (sample.mode == ProxyMode::kConstrained) {
            EXPECT_LE(sample.density, 0.5 + 1e-9);
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace palpate
