// Keyframes: a computation that goes on from one gives the same bits.
#include "server/servo/servo_memory.h"

#include <gtest/gtest.h>

#include <functional>
#include <initializer_list>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "server/servo/servo_tick.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/device_numbers.h"
#include "tests/support/layered.h"
#include "tests/support/made_volume.h"
#include "tests/support/recording.h"

namespace palpate {
namespace {

Scene SceneWithEverything(std::shared_ptr<const VolumeSnapshot> volume, double tau,
                          int refinement = 1) {
  Scene scene;
  scene.settings.static_friction = 0.4;
  scene.settings.dynamic_friction = 0.3;
  scene.settings.passivity_control = true;
  scene.settings.pop_force_n = 3.0;
  scene.settings.force_shading = true;
  scene.settings.texture_force_n = 0.2;
  scene.settings.stiffness_n_per_mm = 0.8;
  AffineMap X_DI;
  X_DI.linear *= 1.7;
  X_DI.translation = Vec3(-40.0, -40.0, -40.0);
  scene.surface = MakeHapticSurface(*volume, X_DI, tau, DecompositionMethod::kTpbcc, 1,
                                    FreeSide::kBelow, refinement);
  scene.isovalue = volume->Denormalize(tau);
  scene.volume = std::move(volume);
  return scene;
}

Scene SceneWithLayers(std::shared_ptr<const VolumeSnapshot> volume) {
  Scene scene = SceneWithEverything(std::move(volume), 0.47, 2);
  scene.layers = std::make_shared<const HapticLayers>(testing::LayersOf(
      {{.id = 4, .isovalue = 0.3, .stiffness_n_per_mm = 0.3, .pop_in_n = 0.4, .pop_out_n = 0.2},
       {.id = 2, .isovalue = 0.301, .stiffness_n_per_mm = 1.5, .pop_in_n = 0.6, .pop_out_n = 0.2},
       {.id = 3, .isovalue = 0.6, .viscosity_n_s_per_m = 1.0}}));
  scene.surface.layers = scene.layers.get();
  return scene;
}

// From a keyframe on, in each of many states, and a cold cache of cells.
TEST(ServoKeyframe, GoesOnBitForBit) {
  const auto volume = testing::Gyroid();
  const Scene scenes[] = {SceneWithEverything(volume, 0.47), SceneWithLayers(volume),
                          SceneWithEverything(volume, 0.55, 3)};
  const DeviceDescription spec = SimulatedDeviceSpec();
  SimulatedDevice device(std::make_unique<ExploreScript>(Vec3(-80, -60, -35), Vec3(80, 60, 35), 1));
  device.Start();
  ServoTick tick(device);
  std::unique_ptr<TickComputation> again;
  int same = 0, contacts = 0, deepest = 0, slack = 0;
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
    const Scene& scene = scenes[n / 700 % 3];
    TickSample live = tick.Run(scene, {.missed = static_cast<std::uint64_t>(n / 900)});
    live.time_ns = live.update_ns = 0;
    same += testing::SameSample(live, again->Run(scene, again->InputOf(live)));
    contacts += live.contact;
    deepest += live.layers_passed == 2;
    ServoMemory memory;
    slack += Load(tick.Keyframe().view(), memory) && memory.renderer.slack_mm > 0.0;
  }
  EXPECT_EQ(same, kTicks);
  EXPECT_GT(deepest, 10);
  EXPECT_GT(slack, 10);
  EXPECT_GT(contacts, kTicks / 4);
}

// A stylus that touches a surface, and the state of the servo then.
struct Touch {
  Scene scene = SceneWithEverything(testing::Gyroid(), 0.47);
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

void SetBox(Touch& touch, double y_mm = 20.5, std::uint8_t faces = 0x21) {
  touch.memory.renderer.proxy.contact = Contact::kNone;
  touch.place().kind = Place::Kind::kBox;
  touch.place().cell = Vec3i(20, 20, 20);
  touch.place().p_L = Vec3(20.0, y_mm, 21.0);
  touch.place().faces = faces;
}

TEST(ServoKeyframe, StatesThatNoServoHasAreRefused) {
  using test::kInfinity;
  using test::kNan;
  const Touch touch;
  ServoMemory loaded;
  const auto refuses = [&](const std::function<void(Touch&)>& attack) {
    Touch changed = touch;
    attack(changed);
    return !Load(Save(changed.memory).view(), loaded);
  };
  EXPECT_FALSE(refuses([](Touch&) {}));
  EXPECT_FALSE(refuses([](Touch& t) { SetBox(t); }));
  // Weights below 0, of 0, above 1, and none; no vertices, and one twice.
  EXPECT_TRUE(refuses([](Touch& t) {
    SetCarrier(t.place(), {2, 5}, 0.5);
    t.place().carrier.weight = {1.5, -0.5};
  }));
  for (const double bad : {0.0, 1e300, kNan}) {
    EXPECT_TRUE(refuses([&](Touch& t) { SetCarrier(t.place(), {2, 5}, bad); })) << bad;
  }
  EXPECT_TRUE(refuses([](Touch& t) { SetCarrier(t.place(), {}, 0.0); }));
  EXPECT_TRUE(refuses([](Touch& t) { SetCarrier(t.place(), {2, 2}, 0.5); }));
  // Other faces, all faces, and a tetrahedron with three vertices.
  EXPECT_TRUE(refuses([](Touch& t) { t.place().faces ^= 0x3f; }));
  EXPECT_TRUE(refuses([](Touch& t) { t.place().faces = 0x3f; }));
  EXPECT_TRUE(refuses([](Touch& t) {
    SetCarrier(t.place(), {2, 10, 14}, 1.0 / 3.0);
    t.place().tetrahedron = 3;
  }));
  // On the surface of a box, beside it, nowhere in it, on faces that it is not on, off one that it
  // is on, and nowhere outside.
  EXPECT_TRUE(refuses([](Touch& t) {
    SetBox(t);
    t.memory.renderer.proxy.contact = Contact::kUpper;
  }));
  EXPECT_TRUE(refuses([](Touch& t) { SetBox(t, 22.0); }));
  EXPECT_TRUE(refuses([](Touch& t) { SetBox(t, kNan); }));
  EXPECT_TRUE(refuses([](Touch& t) { SetBox(t, 20.5, 0x25); }));
  EXPECT_TRUE(refuses([](Touch& t) { SetBox(t, 20.5, 0x20); }));
  EXPECT_TRUE(refuses([](Touch& t) {
    SetBox(t);
    t.place().kind = Place::Kind::kOutside;
    t.place().p_L.x() = kInfinity;
  }));
  EXPECT_TRUE(refuses([](Touch& t) { t.memory.renderer.has_hip = false; }));
  // Positions, directions and isovalues that are none, or too large.
  using Renderer = decltype(ServoMemory::renderer);
  const std::function<double&(Renderer&)> numbers[] = {
      [](Renderer& r) -> double& { return r.proxy.p_DH_mm.x(); },
      [](Renderer& r) -> double& { return r.p_DHip_mm.x(); },
      [](Renderer& r) -> double& { return r.p_DLastHip_mm.x(); },
      [](Renderer& r) -> double& { return r.friction.normal_D.x(); },
      [](Renderer& r) -> double& { return r.proxy.isovalue; },
      [](Renderer& r) -> double& { return r.proxy.lower; },
      [](Renderer& r) -> double& { return r.slack_mm; },
      [](Renderer& r) -> double& { return r.friction.slid_mm; }};
  for (std::size_t n = 0; n < std::size(numbers); ++n) {
    for (const double bad : {kNan, 1e300, -1e300}) {
      EXPECT_TRUE(refuses([&](Touch& t) { numbers[n](t.memory.renderer) = bad; })) << n;
    }
  }
}

// Without tools, the renderer's memory ended earlier.
std::string WithoutTools(const ServoMemory& memory) {
  std::string bytes(Save(memory).view());
  constexpr std::size_t kAfterRenderer = 149 + 72;
  bytes.erase(bytes.size() - kAfterRenderer - 1, 1);
  bytes[0] = 7;
  return bytes;
}

TEST(ServoKeyframe, OneWithoutToolsGoesOn) {
  const Touch touch;
  ServoMemory loaded;
  ASSERT_TRUE(Load(WithoutTools(touch.memory), loaded));
  EXPECT_TRUE(Save(loaded).view() == Save(touch.memory).view());
}

// Without torque, the safety stage's memory ended earlier.
std::string WithoutTorque(const ServoMemory& memory) {
  std::string bytes = WithoutTools(memory);
  constexpr std::size_t kCounts = 32, kTorque = 72;
  bytes.erase(bytes.size() - kCounts - kTorque, kTorque);
  bytes[0] = 6;
  return bytes;
}

TEST(ServoKeyframe, OneWithoutTorqueGoesOn) {
  const Touch touch;
  ServoMemory loaded;
  ASSERT_TRUE(Load(WithoutTorque(touch.memory), loaded));
  EXPECT_TRUE(Save(loaded).view() == Save(touch.memory).view());
}

// Without layers, a keyframe had the sign of the side that was felt, and no bounds.
std::string WithoutLayers(const ServoMemory& memory) {
  ServoMemory old = memory;
  Proxy& proxy = old.renderer.proxy;
  if (old.renderer.passed != 0) {
    proxy.isovalue = -proxy.lower;
    proxy.free_side = FreeSide::kAbove;
    proxy.contact = proxy.on_surface() ? Contact::kUpper : Contact::kNone;
  }
  std::string bytes = WithoutTorque(old);
  constexpr std::size_t kBounds = 143, kAfterRenderer = 149;  // from the beginning and from the end
  bytes.erase(bytes.size() - kAfterRenderer - 21, 21);
  bytes.erase(kBounds, 12);
  bytes[0] = 5;
  return bytes;
}

TEST(ServoKeyframe, OneWithoutLayersGoesOnBehindTheSurfaceThatItPopped) {
  Touch touch;
  touch.memory.renderer.friction.slid_mm = 0.0;  // nor a grain
  EXPECT_EQ(WithoutLayers(touch.memory).size(), 1000u);
  for (int n = 0; n < 2; ++n) {
    ServoMemory loaded;
    ASSERT_TRUE(Load(WithoutLayers(touch.memory), loaded));
    EXPECT_TRUE(Save(loaded).view() == Save(touch.memory).view());
    ASSERT_TRUE(Load(WithoutLayers(touch.memory) + '\3', loaded));
    EXPECT_EQ(loaded.renderer.proxy.refinement, 3);
    for (const char refinement : {0, kMaxRefinement + 1, -1}) {
      EXPECT_FALSE(Load(WithoutLayers(touch.memory) + refinement, loaded));
    }
    touch.memory.renderer.passed = 1;
    touch.memory.renderer.proxy.lower = touch.memory.renderer.proxy.isovalue;
    touch.memory.renderer.proxy.isovalue = kUnbounded;
    touch.memory.renderer.proxy.contact = Contact::kLower;
  }
  touch.memory.renderer.passed = 2;
  ServoMemory loaded;
  EXPECT_FALSE(Load(WithoutLayers(touch.memory), loaded));
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
  Touch waiting = touch;  // for another refinement, on a lattice that the scene does not have
  waiting.memory.renderer.proxy.refinement = 3;
  waiting.place().cell = Vec3i(-2, 48, 1 << 30);
  EXPECT_TRUE(testing::SameSample(waiting.Next(), expected));
  EXPECT_FALSE(testing::SameSample(touch.Next(), expected));
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
  EXPECT_FALSE(Load(good + '\1', memory));
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
