// A recording holds enough: the ticks that it names, run again, give the same bits.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "server/device/explore_script.h"
#include "server/device/simulated_device.h"
#include "server/recording/recorded_scene.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_reader.h"
#include "server/servo/servo_tick.h"
#include "tests/support/array_volume.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

constexpr std::uint64_t kTicks = 8000;

std::shared_ptr<const VolumeSnapshot> Gyroid() {
  return testing::MakeVolume({48, 48, 48}, [](int i, int j, int k) {
    constexpr double kTurn = 2.0 * M_PI / 24.0;
    return std::sin(kTurn * i) * std::cos(kTurn * j) + std::sin(kTurn * j) * std::cos(kTurn * k) +
           std::sin(kTurn * k) * std::cos(kTurn * i);
  });
}

// Scene n of the recording: other settings, isovalue, side and place.
Scene SceneNumber(const std::shared_ptr<const VolumeSnapshot>& volume, std::uint64_t n) {
  Scene scene;
  scene.volume = volume;
  scene.settings_revision = n + 1;
  scene.scene_revision = n + 1;
  scene.settings.stiffness_n_per_mm = 0.3 + 0.1 * static_cast<double>(n);
  scene.settings.damping_n_s_per_m = 0.7;
  scene.settings.static_friction = 0.4;
  scene.settings.dynamic_friction = 0.3;
  scene.settings.force_shading = n % 2 == 1;
  scene.settings.passivity_control = n >= 2;
  scene.settings.free_side = n == 3 ? FreeSide::kAbove : FreeSide::kBelow;
  AffineMap X_DI;
  X_DI.linear *= 1.7;
  X_DI.translation = Vec3(-40.0, -40.0 + 0.1 * static_cast<double>(n / 2), -40.0);
  const double tau = 0.47 + 0.02 * static_cast<double>(n);
  scene.isovalue = volume->Denormalize(tau);
  scene.surface = MakeHapticSurface(*volume, X_DI, tau, DecompositionMethod::kTpbcc, 1 + n / 2,
                                    scene.settings.free_side);
  return scene;
}

std::string Record(const std::shared_ptr<const VolumeSnapshot>& volume) {
  const auto bytes = std::make_shared<std::string>();
  Recorder recorder(std::make_unique<testing::MemoryOutput>(bytes), "test");
  SimulatedDevice device(std::make_unique<ExploreScript>(Vec3(-80, -60, -35), Vec3(80, 60, 35), 1));
  device.Start();
  ServoTick servo(device);
  const VolumeHash hash = HashVolume(*volume);
  Scene scene;
  for (std::uint64_t tick = 0; tick < kTicks; ++tick) {
    if (tick % 2000 == 0) {
      scene = SceneNumber(volume, tick / 2000);
      recorder.NoteScene(ToRecorded(scene, hash, kTickPeriodS, device.spec().max_force_n));
    }
    // The device fails for a while.
    if (tick == 5000) device.Stop();
    if (tick == 5010) device.Start();
    recorder.OnSample(servo.Run(scene, {.missed = tick / 900}));
  }
  EXPECT_EQ(recorder.Stop().counts.ticks, kTicks);
  return *bytes;
}

// What ServoTick does, from recorded numbers alone.
class Replay {
 public:
  explicit Replay(std::shared_ptr<const VolumeSnapshot> volume)
      : volume_(std::move(volume)), hash_(HashVolume(*volume_)) {}

  void Begin(const RecordedScene& recorded) {
    scene_ = ToScene(recorded, volume_, hash_);
    period_s_ = recorded.tick_period_s;
    if (!safety_) safety_.emplace(SafetyLimits{.max_force_n = recorded.max_force_n});
  }

  // The same force came out.
  bool Run(const TickSample& sample) {
    const double elapsed_s =
        period_s_ * (1.0 + static_cast<double>(sample.missed_ticks - last_.missed_ticks));
    const HapticOutput output =
        StepRenderer(scene_.surface, scene_.settings, ToVec3(sample.hip_mm), elapsed_s, state_);
    Vec3 force_n = safety_->Limit(output.force_D_n, period_s_);
    if (sample.faulty_ticks != last_.faulty_ticks) force_n = safety_->CutOff();
    TellWrittenForce(force_n, state_);
    last_ = sample;
    return force_n == ToVec3(sample.force_n) && output.proxy.p_DH_mm == ToVec3(sample.scp_h_mm) &&
           output.visual.p_DV_mm == ToVec3(sample.scp_v_mm);
  }

 private:
  static Vec3 ToVec3(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

  std::shared_ptr<const VolumeSnapshot> volume_;
  VolumeHash hash_;
  Scene scene_;
  double period_s_ = 0.0;
  std::optional<Safety> safety_;
  RendererState state_;
  TickSample last_;
};

TEST(RecordingReplay, GivesTheSameForcesBitForBit) {
  const auto volume = Gyroid();
  RecordingReader reader = testing::ReadBytes(Record(volume));
  Replay replay(volume);
  std::uint64_t same = 0, contacts = 0, scenes = 0;
  while (const std::optional<RecordedChunk> chunk = reader.Next()) {
    if (const auto* scene = std::get_if<RecordedScene>(&*chunk)) {
      replay.Begin(*scene);
      ++scenes;
    }
    const auto* samples = std::get_if<RecordedSamples>(&*chunk);
    if (!samples) continue;
    for (const TickSample& sample : *samples) {
      same += replay.Run(sample);
      contacts += sample.contact;
    }
  }
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(scenes, 4u);
  EXPECT_EQ(same, kTicks);
  EXPECT_GT(contacts, kTicks / 4);
}

TEST(RecordingReplay, IsRefusedOnAnotherVolumeOrUnknownSettings) {
  const auto volume = Gyroid();
  const VolumeHash hash = HashVolume(*volume);
  RecordedScene scene = ToRecorded(SceneNumber(volume, 0), hash, kTickPeriodS, 3.3);
  EXPECT_EQ(testing::Refusal([&] { ToScene(scene, volume, hash); }), std::nullopt);
  EXPECT_EQ(testing::Refusal([&] {
              ToScene(scene, volume, {hash.high, hash.low + 1});
            }),
            ErrorKind::kConflict);
  scene.unknown_settings = {"texture_mm"};
  EXPECT_EQ(testing::Refusal([&] { ToScene(scene, volume, hash); }), ErrorKind::kConflict);
}

}  // namespace
}  // namespace palpate
