// Keyframes: a computation that goes on from one gives the same bits.
#include "server/servo/servo_memory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "server/device/explore_script.h"
#include "server/device/simulated_device.h"
#include "server/servo/servo_tick.h"
#include "tests/support/made_volume.h"
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

// A stylus that touches a surface, and the state of the servo then.
struct Touch {
  Scene scene = SceneWithEverything(Gyroid(), 0.47);
  TickSample sample;
  std::string keyframe;
  ServoMemory memory;

  Touch() {
    SimulatedDevice device(
        std::make_unique<ExploreScript>(Vec3(-80, -60, -35), Vec3(80, 60, 35), 1));
    device.Start();
    ServoTick tick(device);
    for (int n = 0; n < 20000 && !(n > 3000 && sample.contact); ++n) sample = tick.Run(scene, {});
    EXPECT_TRUE(sample.contact);
    keyframe = tick.Keyframe().view();
    EXPECT_TRUE(Load(keyframe, memory));
  }
  Place& place() { return memory.renderer.proxy.place; }

  // What the next tick computes from `memory`.
  TickSample Next() const {
    auto computation = std::make_unique<TickComputation>(SafetyLimits{});
    EXPECT_TRUE(computation->Resume(Save(memory).view()));
    return computation->Run(scene, computation->InputOf(sample));
  }
};

void SetCarrier(Place& place, std::initializer_list<std::uint8_t> vertices, double weight) {
  place.carrier = {};
  for (const std::uint8_t vertex : vertices) {
    place.carrier.vertex[place.carrier.count] = vertex;
    place.carrier.weight[place.carrier.count++] = weight;
  }
  place.faces = FacesOf(place.carrier);
  place.tetrahedron = -1;
}

void SetBox(Touch& touch) {
  touch.memory.renderer.proxy.on_surface = false;
  touch.place().kind = Place::Kind::kBox;
  touch.place().cell = Vec3i(20, 20, 20);
  touch.place().p_I = Vec3(20.0, 20.5, 21.0);
  touch.place().faces = 0x21;
}

TEST(ServoKeyframe, StatesThatNoServoHasAreRefused) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  using Attack = std::function<void(Touch&)>;
  const std::vector<std::pair<const char*, Attack>> attacks = {
      {"a weight below 0",
       [](Touch& t) {
         SetCarrier(t.place(), {2, 5}, 0.5), t.place().carrier.weight = {1.5, -0.5};
       }},
      {"weights of 0",
       [](Touch& t) {
         SetCarrier(t.place(), {2, 5}, 0.0);
       }},
      {"weights above 1",
       [](Touch& t) {
         SetCarrier(t.place(), {2, 5}, 1e300);
       }},
      {"weights that are no numbers",
       [](Touch& t) {
         SetCarrier(t.place(), {2, 5}, kNan);
       }},
      {"no vertices", [](Touch& t) { SetCarrier(t.place(), {}, 0.0); }},
      {"a vertex twice",
       [](Touch& t) {
         SetCarrier(t.place(), {2, 2}, 0.5);
       }},
      {"other faces", [](Touch& t) { t.place().faces ^= 0x3f; }},
      {"all faces", [](Touch& t) { t.place().faces = 0x3f; }},
      {"a tetrahedron with three vertices",
       [](Touch& t) {
         SetCarrier(t.place(), {2, 10, 14}, 1.0 / 3.0), t.place().tetrahedron = 3;
       }},
      {"on the surface of a box",
       [](Touch& t) { SetBox(t), t.memory.renderer.proxy.on_surface = true; }},
      {"beside its box", [](Touch& t) { SetBox(t), t.place().p_I.y() = 22.0; }},
      {"nowhere in its box", [](Touch& t) { SetBox(t), t.place().p_I.y() = kNan; }},
      {"on faces of the box that it is not on",
       [](Touch& t) { SetBox(t), t.place().faces = 0x25; }},
      {"off a face of the box that it is on", [](Touch& t) { SetBox(t), t.place().faces = 0x20; }},
      {"nowhere outside",
       [](Touch& t) {
         SetBox(t), t.place().kind = Place::Kind::kOutside, t.place().p_I.x() = kInfinity;
       }},
      {"placed without a stylus", [](Touch& t) { t.memory.renderer.has_hip = false; }},
      {"a proxy nowhere", [](Touch& t) { t.memory.renderer.proxy.p_DH_mm.x() = kNan; }},
      {"a proxy far away", [](Touch& t) { t.memory.renderer.proxy.p_DH_mm.x() = 1e300; }},
      {"a stylus nowhere", [](Touch& t) { t.memory.renderer.p_DHip_mm.x() = kNan; }},
      {"a stylus that was far away", [](Touch& t) { t.memory.renderer.p_DLastHip_mm.x() = 1e300; }},
      {"friction that is no direction",
       [](Touch& t) { t.memory.renderer.friction.normal_D.x() = kNan; }},
      {"friction across the room", [](Touch& t) { t.memory.renderer.friction.normal_D.x() = 1e9; }},
  };
  const Touch touch;
  for (const auto& [name, attack] : attacks) {
    Touch changed = touch;
    attack(changed);
    ServoMemory loaded;
    EXPECT_FALSE(Load(Save(changed.memory).view(), loaded)) << name;
  }
  Touch box = touch;
  SetBox(box);
  ServoMemory loaded;
  EXPECT_TRUE(Load(Save(box.memory).view(), loaded));
}

// What a keyframe alone cannot tell: the cells are the scene's. The proxy begins anew.
TEST(ServoKeyframe, APlaceThatItsCellLacksIsNotUsed) {
  const Touch touch;
  Touch anew = touch;
  anew.memory.renderer.proxy = {};
  const TickSample expected = anew.Next();
  const auto expect_anew = [&](const char* name, const std::function<void(Place&)>& change) {
    Touch changed = touch;
    change(changed.place());
    EXPECT_TRUE(testing::SameSample(changed.Next(), expected)) << name;
  };
  expect_anew("a second vertex inside, where cells have one",
              [](Place& place) { SetCarrier(place, {15}, 1.0); });
  expect_anew("vertices of no tetrahedron", [](Place& place) { SetCarrier(place, {0, 6}, 0.5); });
  expect_anew("another tetrahedron's vertices", [](Place& place) {
    SetCarrier(place, {0, 4, 12, 14}, 0.25);
    place.tetrahedron = 29;
  });
  expect_anew("a cell outside", [](Place& place) { place.cell = Vec3i(-2, 48, 1 << 30); });
  EXPECT_FALSE(testing::SameSample(touch.Next(), expected));
}

TEST(ServoKeyframe, CountsOfTicksDoNotOverflow) {
  Touch touch;
  Proxy& proxy = touch.memory.renderer.proxy;
  proxy = {};
  proxy.placed = proxy.buried = true;
  proxy.buried_steps = std::numeric_limits<int>::max();
  touch.scene.surface.isovalue = -1.0;  // everything is inside
  touch.scene.settings.pop_force_n = 0.0;
  auto computation = std::make_unique<TickComputation>(SafetyLimits{});
  ASSERT_TRUE(computation->Resume(Save(touch.memory).view()));
  EXPECT_EQ(computation->Run(touch.scene, computation->InputOf(touch.sample)).mode,
            TickMode::kFault);
  ServoMemory after;
  ASSERT_TRUE(Load(computation->Keyframe().view(), after));
  EXPECT_EQ(after.renderer.proxy.buried_steps, std::numeric_limits<int>::max());
}

TEST(ServoKeyframe, AnIsovalueThatIsNoneIsRefused) {
  Touch touch;
  ServoMemory after;
  ASSERT_TRUE(Load(Save(touch.memory).view(), after));
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), 1e300, -1e300}) {
    touch.memory.renderer.proxy.isovalue = bad;
    EXPECT_FALSE(Load(Save(touch.memory).view(), after)) << bad;
  }
}

// What is no keyframe is refused, or at least harmless: every byte is tried.
TEST(ServoKeyframe, DamagedOnesDoNoHarm) {
  const Touch touch;
  const Scene& scene = touch.scene;
  const TickSample& sample = touch.sample;
  const std::string& good = touch.keyframe;
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
