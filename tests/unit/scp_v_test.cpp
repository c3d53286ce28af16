// SCP_V is added to samples behind the servo's back: with the scene of their tick, however late.
#include "server/pump/pose_of.h"

#include <gtest/gtest.h>

#include <cmath>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <random>
#include <vector>

#include "server/pump/pump.h"
#include "server/servo/tick_computation.h"
#include "tests/support/made_volume.h"
#include "tests/support/patience.h"

namespace palpate {
namespace {

// Holds the pump up, and keeps what comes.
class SlowSink : public SampleSink {
 public:
  void OnSample(const TickSample& sample) override {
    std::unique_lock lock(mutex_);
    open_.wait(lock, [&] { return is_open_; });
    samples_.push_back(sample);
  }
  void Open() {
    const std::lock_guard lock(mutex_);
    is_open_ = true;
    open_.notify_all();
  }
  std::vector<TickSample> samples() {
    const std::lock_guard lock(mutex_);
    return samples_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable open_;
  bool is_open_ = false;
  std::vector<TickSample> samples_;
};

// The density rises towards -z, and τ moves through the volume from scene to scene.
TEST(ScpV, IsOfTheSceneOfItsTickHoweverLateTheSampleIs) {
  constexpr int kScenes = 50;
  const auto volume =
      testing::MakeVolume(Vec3i::Constant(12), [](int, int, int k) { return 11.0 - k; });
  const auto outbox = std::make_unique<TickOutbox>();
  SceneInbox inbox;
  Pump pump(*outbox, inbox);
  const auto sink = std::make_shared<SlowSink>();
  pump.Subscribe(sink);
  pump.Start();
  TickComputation computation{SafetyLimits{}};
  for (int n = 0; n < kScenes; ++n) {
    auto scene = std::make_unique<Scene>();
    scene->volume = volume;
    scene->isovalue = 4.0 + 0.05 * n;
    scene->scene_revision = static_cast<std::uint64_t>(n + 1);
    scene->settings.free_side = n % 20 < 10 ? FreeSide::kBelow : FreeSide::kAbove;
    scene->surface = MakeHapticSurface(*volume, AffineMap(), volume->Normalize(scene->isovalue),
                                       DecompositionMethod::kTpbcc, 1, scene->settings.free_side);
    inbox.Publish(std::move(scene));
    const Scene& felt = *inbox.Acquire();
    inbox.Collect();
    TickInput input;
    input.stylus.calibrated = true;
    for (int tick = 0; tick < 60; ++tick) {
      input.stylus.p_DHip_mm = Vec3(5.3, 5.4, tick < 30 ? 11.0 : 1.5);
      if (felt.settings.free_side == FreeSide::kAbove) {
        input.stylus.p_DHip_mm.z() = 11.0 - input.stylus.p_DHip_mm.z();
      }
      EXPECT_TRUE(outbox->TryPush(computation.Run(felt, input)));
    }
  }
  inbox.ReaderStopped();
  sink->Open();
  ASSERT_TRUE(test::Eventually([&] { return sink->samples().size() == kScenes * 60; }));
  pump.Stop();
  int in_contact = 0;
  for (const TickSample& sample : sink->samples()) {
    if (!sample.contact) continue;
    ++in_contact;
    ASSERT_TRUE(sample.has_scp_v);
    // The isovalue glides for a while: the sample's own is the one that was felt.
    EXPECT_NEAR(sample.scp_v_mm[2], 11.0 - sample.isovalue, 1e-9);
    EXPECT_NEAR(std::abs(sample.scp_v_normal[2]), 1.0, 1e-9);
  }
  EXPECT_GT(in_contact, kScenes * 20);
}

// Bit by bit that of the renderer's own state, whatever is felt and from whichever side.
TEST(ScpV, FollowsFromTheSampleAsFromTheState) {
  const auto volume = testing::Gyroid(24);
  Scene scene;
  scene.volume = volume;
  scene.isovalue = volume->Denormalize(0.5);
  TickComputation computation{SafetyLimits{}};
  const auto state = std::make_unique<RendererState>();
  const auto cells = std::make_unique<CellCache>();
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  int found = 0, differ = 0;
  TickInput input;
  input.stylus.calibrated = true;
  input.stylus.p_DHip_mm = Vec3::Constant(12.0);
  for (int tick = 0; tick < 20'000; ++tick) {
    if (tick % 1000 == 0) {
      scene.settings.static_friction = 0.3 * (tick / 1000 % 2);
      scene.settings.pop_force_n = 0.4 * (tick / 2000 % 2);
      ++scene.scene_revision;
      scene.surface = MakeHapticSurface(*volume, AffineMap(), 0.5, DecompositionMethod::kTpbcc, 1);
    }
    for (double& x : input.stylus.p_DHip_mm) x += 0.2 * normal(random) + 0.01 * (12.0 - x);
    TickSample sample = computation.Run(scene, input);
    AddScpV(scene, *cells, sample);
    const HapticOutput output =
        StepRenderer(scene.surface, scene.settings, input.stylus.p_DHip_mm, kTickPeriodS, *state);
    const VisualProxy visual = VisualProxyOf(scene.surface, output, *state);
    found += visual.found && output.free_side == FreeSide::kAbove;
    differ += sample.has_scp_v != visual.found || Vec3(sample.scp_v_mm.data()) != visual.p_DV_mm ||
              Vec3(sample.scp_v_normal.data()) != visual.normal_D ||
              (sample.has_scp_v && !sample.contact);
  }
  EXPECT_EQ(differ, 0);
  EXPECT_GT(found, 100);
}

}  // namespace
}  // namespace palpate
