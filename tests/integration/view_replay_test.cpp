// What the window draws from, in a replay by another client.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <random>
#include <thread>

#include "server/recording/recording_reader.h"
#include "tests/support/live_view.h"
#include "tests/support/recording.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::view {
namespace {

using test::Follow;

constexpr int kTicks = 50;

class ViewReplay : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_.Start();
    other_.emplace(client::ClientOptions{.address = {.socket_path = daemon_.socket()}});
  }

  void Hold() {
    const std::uint64_t end = other_->GetRecording().ticks + 60;
    ASSERT_TRUE(test::Eventually([&] { return other_->GetRecording().ticks >= end; }));
  }
  void Set(const client::SettingsUpdate& update) {
    other_->Set(update);
    ASSERT_TRUE(test::Eventually([&] { return !other_->GetSettings().ball.is_awaited; }));
    Hold();
  }
  void Record() {
    client::PlacementChange move;
    move.translate_mm = Vec3(2, 0, 0);
    other_->StartRecording(file_);
    Set({.isovalue = 0.4});
    Set({.isovalue = 0.5, .tool_radius_mm = 2.0});
    other_->Place(move);
    Set({.stiffness_n_per_mm = 0.2, .tool_radius_mm = 0.0});
    Set({.free_side = client::FreeSide::kAbove});
    client::SettingsUpdate layers, tool, none;
    layers.free_side = client::FreeSide::kBelow;
    layers.layers = {{{.name = "skin", .isovalue = 0.3}, {.name = "bone", .isovalue = 0.6}}};
    Set(layers);
    other_->Place(move);
    none.layers.emplace();
    tool.tool = {.name = "rod", .ball = {{.radius_mm = 1.0}}};
    Set(none);
    Set(tool);
    other_->StopRecording();
    client::SettingsUpdate live{.isovalue = 0.9};
    live.tool.emplace();
    other_->Set(live);
  }

  test::RestartedDaemon daemon_;
  const std::string file_ = daemon_.folder() / "a.mcap";
  std::optional<client::Client> other_;
};

TEST_F(ViewReplay, IsDrawnWithTheSceneOfTheTick) {
  Record();
  std::map<std::uint64_t, RecordedScene> scenes;  // by their first tick
  std::vector<TickSample> ticks;
  RecordingReader reader(file_);
  const std::vector<RecordedItem> items = testing::ReadAll(reader);
  for (const RecordedItem& item : items) {
    if (const auto* scene = std::get_if<RecordedScene>(&item)) scenes[scene->tick] = *scene;
  }
  ticks = testing::SamplesIn(items);

  LiveFeed feed({.address = {.socket_path = daemon_.socket()}});
  std::mt19937 random(1);
  for (int n = 0; n < kTicks; ++n) {
    const std::size_t place = random() % (ticks.size() - 1);
    SCOPED_TRACE(place);
    const RecordedScene& scene = std::prev(scenes.upper_bound(ticks[place].tick))->second;
    std::atomic<bool> stops = false;
    std::thread replay([&] {
      // Until the replay before has ended, there is none.
      while (!stops) {
        EXPECT_THROW(other_->Replay(file_, {.speed = 1e-6, .first_tick = place},
                                    [&](const client::ReplayState&) { return !stops; }),
                     Error);
      }
    });
    EXPECT_TRUE(Follow(feed, [&] {
      const auto& pose = feed.pose();
      return feed.is_replay() && feed.settings()->revision == pose->settings_revision &&
             feed.volume().revision() &&
             feed.volume().revision()->volume_revision == pose->volume_revision &&
             feed.volume().X_DI() == scene.X_DI;
    }));
    const client::Settings& shown = *feed.settings();
    EXPECT_TRUE(shown.replayed);
    EXPECT_EQ(shown.isovalue, scene.isovalue);
    EXPECT_EQ(shown.stiffness_n_per_mm, scene.settings.stiffness_n_per_mm);
    EXPECT_EQ(shown.tool_radius_mm, scene.settings.tool_radius_mm);
    EXPECT_EQ(shown.free_side, scene.settings.free_side);
    EXPECT_EQ(shown.layers, scene.settings.layers);
    EXPECT_EQ(shown.tool, scene.settings.tool);
    if (scene.settings.tool.ball.empty()) {
      EXPECT_EQ(shown.ball.is_awaited,
                std::abs(shown.tool_radius_mm - ticks[place].tool_radius_mm) > 1e-9);
    }
    EXPECT_NEAR(shown.ball.felt_radius_mm, ticks[place].tool_radius_mm, 1e-9);
    EXPECT_EQ(feed.pose()->hip_mm.x(), ticks[place].hip_mm[0]);
    stops = true;
    replay.join();
    EXPECT_TRUE(Follow(feed, [&] {
      return !feed.is_replay() && !feed.settings()->replayed && feed.settings()->isovalue == 0.9;
    }));
  }
}

}  // namespace
}  // namespace palpate::view
