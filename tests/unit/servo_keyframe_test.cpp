// Keyframes: a computation that goes on from one gives the same bits.
#include "server/servo/servo_keyframe.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <random>
#include <string>

#include "server/device/explore_script.h"
#include "server/device/simulated_device.h"
#include "server/servo/servo_tick.h"
#include "tests/support/array_volume.h"
#include "tests/support/recording.h"

namespace palpate {
namespace {

std::shared_ptr<const VolumeSnapshot> Gyroid() {
  return testing::MakeVolume({48, 48, 48}, [](int i, int j, int k) {
    constexpr double kTurn = 2.0 * M_PI / 24.0;
    return std::sin(kTurn * i) * std::cos(kTurn * j) + std::sin(kTurn * j) * std::cos(kTurn * k) +
           std::sin(kTurn * k) * std::cos(kTurn * i);
  });
}

Scene SceneWithEverything(std::shared_ptr<const VolumeSnapshot> volume, double tau) {
  Scene scene;
  scene.settings.static_friction = 0.4;
  scene.settings.dynamic_friction = 0.3;
  scene.settings.passivity_control = true;
  scene.settings.pop_force_n = 3.0;
  scene.settings.force_shading = true;
  scene.settings.stiffness_n_per_mm = 0.8;
  AffineMap X_DI;
  X_DI.linear *= 1.7;
  X_DI.translation = Vec3(-40.0, -40.0, -40.0);
  scene.surface = MakeHapticSurface(*volume, X_DI, tau, DecompositionMethod::kTpbcc, 1);
  scene.isovalue = volume->Denormalize(tau);
  scene.volume = std::move(volume);
  return scene;
}

TEST(ServoKeyframe, HasASizeThatFits) {
  ServoMemory memory;
  memory.faulty_ticks = 0x0102030405060708;  // the last one
  const ServoKeyframe keyframe = Save(memory);
  std::uint64_t last = 0;
  std::memcpy(&last, &keyframe.bytes[ServoKeyframe::kBytes - sizeof last], sizeof last);
  EXPECT_EQ(last, memory.faulty_ticks);
  ServoMemory loaded;
  ASSERT_TRUE(Load(keyframe.view(), loaded));
  EXPECT_EQ(loaded.faulty_ticks, memory.faulty_ticks);
}

// From a keyframe on, in each of many states, and a cold cache of cells.
TEST(ServoKeyframe, GoesOnBitForBit) {
  const auto volume = Gyroid();
  const Scene scenes[] = {SceneWithEverything(volume, 0.47), SceneWithEverything(volume, 0.55)};
  const DeviceSpec spec = SimulatedDeviceSpec();
  SimulatedDevice device(std::make_unique<ExploreScript>(Vec3(-80, -60, -35), Vec3(80, 60, 35), 1));
  device.Start();
  ServoTick tick(device);
  std::unique_ptr<TickComputation> again;
  int same = 0, contacts = 0;
  constexpr int kTicks = 12000;
  for (int n = 0; n < kTicks; ++n) {
    if (n == 5000) device.Stop();
    if (n == 5100) device.Start();
    if (n % static_cast<int>(kKeyframeTicks) == 0) {
      const ServoKeyframe keyframe = tick.Keyframe();
      EXPECT_EQ(keyframe.tick, static_cast<std::uint64_t>(n));
      again = std::make_unique<TickComputation>(LimitsFor(spec, 0));
      ASSERT_TRUE(again->Resume(keyframe.view()));
      EXPECT_TRUE(again->Keyframe().view() == keyframe.view());
    }
    const Scene& scene = scenes[n / 700 % 2];
    TickSample live = tick.Run(scene, {.missed = static_cast<std::uint64_t>(n / 900)});
    live.time_ns = live.update_ns = 0;
    same += testing::SameSample(live, again->Run(scene, again->InputOf(live)));
    contacts += live.contact;
  }
  EXPECT_EQ(same, kTicks);
  EXPECT_GT(contacts, kTicks / 4);
}

// What is no keyframe is refused, or at least harmless: every byte is tried.
TEST(ServoKeyframe, DamagedOnesDoNoHarm) {
  const auto volume = Gyroid();
  const Scene scene = SceneWithEverything(volume, 0.47);
  SimulatedDevice device(std::make_unique<ExploreScript>(Vec3(-80, -60, -35), Vec3(80, 60, 35), 1));
  device.Start();
  ServoTick tick(device);
  TickSample sample;
  for (int n = 0; n < 20000 && !(n > 3000 && sample.contact); ++n) sample = tick.Run(scene, {});
  ASSERT_TRUE(sample.contact);
  const std::string good(tick.Keyframe().view());
  ServoMemory memory;
  EXPECT_FALSE(Load("", memory));
  EXPECT_FALSE(Load(good.substr(1), memory));
  EXPECT_FALSE(Load(good + "x", memory));
  std::mt19937 random(1);
  int refused = 0;
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (const int value : {0x02, 0x7f, 0xff}) {
      std::string bad = good;
      bad[at] = static_cast<char>(value);
      auto computation = std::make_unique<TickComputation>(SafetyLimits{});
      if (!computation->Resume(bad)) {
        ++refused;
        EXPECT_EQ(computation->next_tick(), 0u);
        continue;
      }
      for (int n = 0; n < 3; ++n) computation->Run(scene, computation->InputOf(sample));
    }
  }
  EXPECT_GT(refused, 20);
}

}  // namespace
}  // namespace palpate
