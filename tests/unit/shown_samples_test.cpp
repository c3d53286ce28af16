// Recorded samples under live ticks.
#include "server/recording/shown_samples.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/recording.h"

namespace palpate {
namespace {

using testing::RandomSample;

TickSample Live(std::uint64_t tick, std::uint64_t missed = 0) {
  TickSample live;
  live.tick = tick;
  live.time_ns = static_cast<std::int64_t>(tick) * 7;
  live.missed_ticks = missed;
  live.scene_revision = 11;
  live.settings_revision = 12;
  live.volume_revision = 13;
  return live;
}

void Fill(ShownSamples& shown, int count) {
  for (int n = 0; n < count; ++n) shown.Add(RandomSample(n), n + 1.0);
}

TEST(ShownSamples, AreLiveUntilTheFirstIsDue) {
  ShownSamples shown(1.0);
  EXPECT_EQ(shown.Shown(Live(5)).hip_mm, Live(5).hip_mm);
  Fill(shown, 3);
  for (std::uint64_t n = 0; n < 3; ++n) {
    const TickSample sample = shown.Shown(Live(6 + n));
    EXPECT_EQ(sample.tick, 6 + n);
    EXPECT_EQ(sample.time_ns, Live(6 + n).time_ns);
    EXPECT_EQ(sample.missed_ticks, 0u);
    EXPECT_EQ(sample.scene_revision, 11u);
    EXPECT_EQ(sample.settings_revision, 12u);
    EXPECT_EQ(sample.volume_revision, 13u);
    EXPECT_EQ(sample.buttons, RandomSample(n).buttons);
    EXPECT_EQ(sample.mode, RandomSample(n).mode);
  }
  // The last one stays, and nothing runs ahead meanwhile.
  EXPECT_EQ(shown.Shown(Live(100)).buttons, RandomSample(2).buttons);
  EXPECT_EQ(shown.position_ms(), 3.0);
  shown.Add(RandomSample(3), 4.0);
  EXPECT_EQ(shown.Shown(Live(101)).buttons, RandomSample(3).buttons);
  EXPECT_EQ(shown.passed(), 4u);
  EXPECT_EQ(shown.waiting(), 0u);
}

TEST(ShownSamples, KeepTheirPace) {
  struct Case {
    double speed;
    std::uint64_t live, passed;
  };
  for (const Case& c :
       {Case{0.25, 400, 100}, Case{1.0, 400, 400}, Case{2.5, 400, 1000}, Case{100.0, 10, 1000}}) {
    ShownSamples shown(c.speed);
    Fill(shown, 2000);
    for (std::uint64_t n = 0; n <= c.live; ++n) shown.Shown(Live(n));
    EXPECT_EQ(shown.passed(), c.passed) << c.speed;
  }
  // Missed live ticks are time that has passed.
  ShownSamples shown(1.0);
  Fill(shown, 100);
  shown.Shown(Live(0));
  shown.Shown(Live(1, 49));
  EXPECT_EQ(shown.passed(), 50u);
}

}  // namespace
}  // namespace palpate
