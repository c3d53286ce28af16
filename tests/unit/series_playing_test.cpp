// Time series that play: which frames come, and how often.
#include "server/session/series_player.h"

#include <gtest/gtest.h>

#include <mutex>
#include <set>
#include <thread>

#include "tests/support/series_rig.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;
using namespace testing;

// Notes the voxels of every scene.
class SceneRecorder : public SceneListener {
 public:
  void OnScene(const Scene& scene, std::span<const BrickChange>) override {
    const std::lock_guard lock(mutex_);
    hashes_.push_back(scene.volume->bricks().content_hash());
  }
  std::vector<ContentHash> Take() {
    const std::lock_guard lock(mutex_);
    return std::move(hashes_);
  }

 private:
  std::mutex mutex_;
  std::vector<ContentHash> hashes_;
};

class PlayingTest : public SeriesPlayerTest {
 protected:
  PlayingTest() { listener_ = &scenes_; }
  // Frames since the last call, in the order in which they were published. A busy
  // machine may leave some out.
  std::vector<int> Shown() {
    std::vector<ContentHash> all;
    for (int frame = 0; frame < kFrames; ++frame) all.push_back(FrameHash(frame));
    std::vector<int> shown;
    for (const ContentHash& hash : scenes_.Take()) {
      shown.push_back(static_cast<int>(std::find(all.begin(), all.end(), hash) - all.begin()));
    }
    return shown;
  }
  bool Stops() {
    return Soon([&] { return !player_->state().playing; });
  }
  SceneRecorder scenes_;
};

TEST_F(PlayingTest, PlaysToTheEndAndStops) {
  Load();
  player_->Control({.playing = true, .rate_hz = 10.0});
  EXPECT_TRUE(Stops());
  EXPECT_TRUE(Shows(4));
  EXPECT_EQ(player_->state().position_frames, 4.0);
  std::vector<int> shown = Shown();
  EXPECT_EQ(shown.front(), kFrames);  // the volume before the series
  EXPECT_EQ(shown[1], 0);
  EXPECT_EQ(shown.back(), 4);
  EXPECT_GE(shown.size(), 4u);
  EXPECT_EQ(std::adjacent_find(shown.begin() + 1, shown.end(), std::greater_equal<>()),
            shown.end());
  // Again from the beginning.
  player_->Control({.playing = true});
  EXPECT_TRUE(Stops());
  EXPECT_TRUE(Shows(4));
  shown = Shown();
  EXPECT_LT(shown.front(), 2);
  EXPECT_EQ(shown.back(), 4);
}

TEST_F(PlayingTest, PlaysBackwards) {
  Load();
  Shown();
  player_->Control({.playing = true, .rate_hz = -10.0});
  EXPECT_TRUE(Stops());
  EXPECT_TRUE(Shows(0));
  EXPECT_EQ(player_->state().position_frames, 0.0);
  const std::vector<int> shown = Shown();
  EXPECT_GT(shown.front(), 2);
  EXPECT_EQ(shown.back(), 0);
  EXPECT_GE(shown.size(), 3u);
  EXPECT_EQ(std::adjacent_find(shown.begin(), shown.end(), std::less_equal<>()), shown.end());
}

TEST_F(PlayingTest, LoopsInBothDirections) {
  Load();
  for (const int direction : {1, -1}) {
    player_->Control({.playing = true, .rate_hz = 10.0 * direction, .loop = true});
    Shown();
    std::this_thread::sleep_for(milliseconds(1500));
    const std::vector<int> shown = Shown();
    ASSERT_GE(shown.size(), 6u);
    int ordinary = 0;
    for (std::size_t n = 2; n < shown.size(); ++n) {
      ordinary += shown[n] == (shown[n - 1] + direction + kFrames) % kFrames;
    }
    EXPECT_GE(2 * ordinary, static_cast<int>(shown.size()) - 2);
    EXPECT_EQ(std::set<int>(shown.begin(), shown.end()).size(), 5u);
  }
  EXPECT_TRUE(player_->state().playing);
}

TEST_F(PlayingTest, APauseHoldsTheFrame) {
  Load();
  player_->Control({.playing = true, .rate_hz = 20.0, .loop = true});
  std::this_thread::sleep_for(milliseconds(120));
  player_->Control({.playing = false});
  std::this_thread::sleep_for(milliseconds(50));
  const std::uint64_t revision = Revision();
  const double position = player_->state().position_frames;
  EXPECT_EQ(Hash(), FrameHash(static_cast<int>(position)));
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_EQ(Revision(), revision);
  EXPECT_EQ(player_->state().position_frames, position);
}

TEST_F(PlayingTest, AtMostSixtyVolumesPerSecondHoweverFast) {
  Load();
  std::uint64_t before = Revision();
  player_->Control({.playing = true, .rate_hz = 1000.0, .loop = true, .interpolate = true});
  std::this_thread::sleep_for(milliseconds(1000));
  player_->Control({.playing = false});
  const std::uint64_t played = Revision() - before;
  EXPECT_LE(played, 62u);
  EXPECT_GE(played, 10u);
  // Nor by seeking.
  before = Revision();
  const auto end = steady_clock::now() + milliseconds(500);
  for (int n = 0; steady_clock::now() < end; ++n) {
    player_->Control({.position_frames = n % kFrames});
    std::this_thread::sleep_for(milliseconds(1));
  }
  EXPECT_LE(Revision() - before, 33u);
}

}  // namespace
}  // namespace palpate
