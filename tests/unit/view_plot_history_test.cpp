// What the plots of the viewer show.
#include "client/view/palpated/plot_history.h"

#include <gtest/gtest.h>

#include <limits>

namespace palpate::view {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

client::Pose PoseWith(double force_n, std::uint64_t missed_ticks, std::int64_t time_ns = 0) {
  client::Pose pose;
  pose.time_ns = time_ns;
  pose.force_n = Vec3(0, 0.6 * force_n, -0.8 * force_n);
  pose.missed_ticks = missed_ticks;
  pose.update_ns = 12500;
  return pose;
}

TEST(PlotHistory, TakesWhatThePoseSays) {
  PlotHistory plots;
  for (int n = 0; n < kPlots; ++n) {
    EXPECT_TRUE(plots.Values(static_cast<Plot>(n)).empty());
    EXPECT_EQ(plots.Newest(static_cast<Plot>(n)), 0.0f);
    EXPECT_EQ(plots.Greatest(static_cast<Plot>(n)), 0.0f);
  }
  client::Pose pose = PoseWith(2.0, 0);
  pose.hip_mm = Vec3(1, 2, 3);
  pose.scp_h_mm = Vec3(1, 5, 7);
  plots.Add(pose, 4.5);
  EXPECT_EQ(plots.Newest(Plot::kPenetration_mm), 0.0f);  // not in contact
  pose.contact = true;
  plots.Add(pose, -1.0);
  EXPECT_FLOAT_EQ(plots.Newest(Plot::kForce_n), 2.0f);
  EXPECT_FLOAT_EQ(plots.Newest(Plot::kPenetration_mm), 5.0f);
  EXPECT_FLOAT_EQ(plots.Newest(Plot::kUpdate_us), 12.5f);
  EXPECT_EQ(plots.Newest(Plot::kStreamAge_ms), 0.0f);
  EXPECT_FLOAT_EQ(plots.Greatest(Plot::kStreamAge_ms), 4.5f);
}

TEST(PlotHistory, CountsTheTicksThatWereMissedBetween) {
  PlotHistory plots;
  // Of a daemon that ran for long before, and of one that was started anew at the end.
  for (const std::uint64_t missed : {1000u, 1000u, 1007u, 2u, 3u}) {
    plots.Add(PoseWith(0, missed), 0);
  }
  const auto values = plots.Values(Plot::kMissedTicks);
  EXPECT_EQ(std::vector<float>(values.begin(), values.end()), (std::vector<float>{0, 0, 7, 0, 1}));
}

// However many come in it, as after a message that took long.
TEST(PlotHistory, HoldsTenSecondsOfTime) {
  PlotHistory plots;
  for (const int rate_hz : {20, 60, 100}) {
    for (int n = 0; n <= 15 * rate_hz; ++n) {
      plots.Add(PoseWith(n, 0, n * kSecond_ns / rate_hz), n);
    }
    const auto times_ns = plots.Times_ns();
    EXPECT_EQ(times_ns.back() - times_ns.front(), PlotHistory::kSpan_ns) << rate_hz;
    EXPECT_EQ(times_ns.size(), 10u * rate_hz + 1);
    for (int n = 0; n < kPlots; ++n) {
      EXPECT_EQ(plots.Values(static_cast<Plot>(n)).size(), times_ns.size());
    }
    EXPECT_FLOAT_EQ(plots.Values(Plot::kForce_n).front(), 5.0f * rate_hz);
    EXPECT_FLOAT_EQ(plots.Newest(Plot::kStreamAge_ms), 15.0f * rate_hz);
  }
  // One that came late has its own time, and what was there before it is kept.
  plots.Add(PoseWith(1, 0, 19 * kSecond_ns), 0);
  EXPECT_EQ(plots.Times_ns().front(), 9 * kSecond_ns);
}

TEST(PlotHistory, RunsEmptyWhereNothingComes) {
  PlotHistory plots;
  for (int n = 0; n <= 100; ++n) plots.Add(PoseWith(n, 0, n * kSecond_ns / 10), n);
  plots.EndAt(15 * kSecond_ns);
  EXPECT_EQ(plots.Times_ns().front(), 5 * kSecond_ns);
  EXPECT_FLOAT_EQ(plots.Greatest(Plot::kForce_n), 100.0f);
  plots.EndAt(21 * kSecond_ns);
  EXPECT_TRUE(plots.Times_ns().empty());
  EXPECT_EQ(plots.Greatest(Plot::kForce_n), 0.0f);
  // A clock that begins anew, as that of a machine that was started again.
  plots.Add(PoseWith(3, 0, 50 * kSecond_ns), 0);
  plots.Add(PoseWith(2, 0, kSecond_ns), 0);
  EXPECT_EQ(plots.Times_ns().size(), 1u);
  EXPECT_FLOAT_EQ(plots.Greatest(Plot::kForce_n), 2.0f);
}

TEST(PlotHistory, DoesNotGrowWhateverComes) {
  PlotHistory plots;
  for (int n = 0; n < 5000; ++n) plots.Add(PoseWith(n, 0, n), n);
  EXPECT_EQ(plots.Times_ns().size(), PlotHistory::kMost);
  EXPECT_EQ(plots.Newest(Plot::kStreamAge_ms), 4999.0f);
}

TEST(PlotHistory, AxesEndAtRoundNumbersAboveTheValue) {
  EXPECT_EQ(AxisTop(0.0f), 1.0f);
  EXPECT_EQ(AxisTop(-3.0f), 1.0f);
  EXPECT_EQ(AxisTop(std::numeric_limits<float>::quiet_NaN()), 1.0f);
  EXPECT_EQ(AxisTop(std::numeric_limits<float>::infinity()), 1.0f);
  EXPECT_FLOAT_EQ(AxisTop(0.83f), 1.0f);
  EXPECT_FLOAT_EQ(AxisTop(1.2f), 2.0f);
  EXPECT_FLOAT_EQ(AxisTop(23.0f), 50.0f);
  EXPECT_FLOAT_EQ(AxisTop(0.06f), 0.1f);
}

}  // namespace
}  // namespace palpate::view
