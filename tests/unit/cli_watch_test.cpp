// `palpate watch` and what it shows: statistics, views, JSON.
#include "client/cli/watch_command.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "client/cli/output.h"
#include "client/cli/watch_statistics.h"
#include "client/cli/watch_view.h"

namespace palpate::cli {
namespace {

constexpr std::int64_t kMs = 1'000'000;

// A message with one sample of the given millisecond, sent `delay_ms` after it.
client::PoseBatch Message(std::uint64_t tick, std::uint64_t missed, std::int64_t update_ns,
                          double delay_ms = 0.0) {
  client::Pose pose;
  pose.tick = tick;
  pose.missed_ticks = missed;
  pose.time_ns = static_cast<std::int64_t>(tick + missed) * kMs;
  pose.update_ns = update_ns;
  pose.mode = client::ProxyMode::kFree;
  pose.density = 1.0;
  pose.isovalue = 2.0;
  client::PoseBatch batch;
  batch.poses = {pose};
  batch.sent_time_ns = pose.time_ns + static_cast<std::int64_t>(delay_ms * kMs);
  return batch;
}

client::Pose ContactPose() {
  client::Pose pose;
  pose.tick = 18446744073709551615u;
  pose.time_ns = 9007199254740993;
  pose.hip_mm = {0.1, 1.0 / 3.0, -2.5};
  pose.scp_h_mm = {1, 2, 3};
  pose.scp_h_normal = Vec3(0, 0, 1);
  pose.scp_v_mm = Vec3(4, 5, 6);
  pose.scp_v_normal = Vec3(0, 1, 0);
  pose.force_n = {0, 3, 4};
  pose.mode = client::ProxyMode::kConstrained;
  pose.contact = true;
  pose.density = 39.99;
  pose.isovalue = -200.0;
  pose.settings_revision = 7;
  pose.volume_revision = 3;
  pose.update_ns = 3200;
  pose.missed_ticks = 11;
  pose.iterations = 4;
  pose.buttons = 5;
  return pose;
}

class WatchStatisticsTest : public ::testing::Test {
 protected:
  // At the time of its sample, or `after_ms` later.
  void Add(const client::PoseBatch& message, std::int64_t after_ms = 0) {
    statistics_.Add(message, message.poses[0].time_ns + after_ms * kMs);
  }
  WatchFigures At(std::int64_t ms) const { return statistics_.Figures(ms * kMs); }

  WatchStatistics statistics_{0, true};
};

TEST_F(WatchStatisticsTest, RatesFollowTheClockOfTheLoop) {
  EXPECT_EQ(At(2000).seconds, 2.0);
  EXPECT_EQ(At(2000).samples, 0u);
  EXPECT_EQ(At(2000).missed_percent, 0.0);
  // 900 ticks and 100 missed in each second of 5.
  for (std::uint64_t i = 0; i <= 5000; i += 10) Add(Message(i - i / 10, i / 10, 1000));
  const WatchFigures figures = At(5000);
  EXPECT_EQ(figures.ticks, 4500u);
  EXPECT_EQ(figures.missed_ticks, 500u);
  EXPECT_NEAR(figures.ticks_per_s, 900.0, 1e-9);
  EXPECT_NEAR(figures.missed_per_s, 100.0, 1e-9);
  EXPECT_NEAR(figures.missed_percent, 10.0, 1e-9);
  EXPECT_NEAR(figures.recent_ticks_per_s, 900.0, 1e-9);
  EXPECT_NEAR(figures.recent_samples_per_s, 100.0, 1e-9);
  EXPECT_EQ(figures.total_missed_ticks, 500u);
}

TEST_F(WatchStatisticsTest, MissesBeforeTheWatchCountOnlyInTheTotal) {
  Add(Message(1000, 1000, 1000));
  Add(Message(2000, 1000, 1000));
  EXPECT_EQ(At(3000).missed_ticks, 0u);
  EXPECT_EQ(At(3000).total_missed_ticks, 1000u);
  EXPECT_NEAR(At(3000).total_missed_percent, 100.0 / 3.0, 1e-9);
}

TEST_F(WatchStatisticsTest, UpdateTimesOfAllAndOfLate) {
  // One update in fifty takes 1 ms, for 10 s; then all take 2 µs.
  for (std::uint64_t i = 0; i < 20000; ++i) {
    Add(Message(i, 0, i < 10000 && i % 50 == 0 ? kMs : 2000));
  }
  const WatchFigures figures = At(20000);
  EXPECT_NEAR(figures.update.mean_us, 2.0 + 998.0 * 0.01, 1e-6);
  EXPECT_NEAR(figures.update.max_us, 1000.0, 1e-9);
  // Exactly one in a hundred is slow: the 99th percentile is the last fast one.
  EXPECT_NEAR(figures.update.p99_us, 2.0, 0.11);
  EXPECT_NEAR(figures.recent_update.mean_us, 2.0, 1e-9);
  EXPECT_NEAR(figures.recent_update.max_us, 2.0, 1e-9);
}

TEST_F(WatchStatisticsTest, P99SeesWhatMoreThanOneInAHundredTakes) {
  for (std::uint64_t i = 0; i < 1000; ++i) Add(Message(i, 0, i % 50 == 0 ? 70'050 : 2000));
  EXPECT_NEAR(At(1000).update.p99_us, 70.05, 0.1);
  EXPECT_NEAR(At(1000).recent_update.p99_us, 70.05, 1e-9);
  // Beyond the histogram.
  Add(Message(1000, 0, 40 * kMs));
  Add(Message(1001, 0, -5));
  EXPECT_NEAR(At(1001).update.max_us, 40000.0, 1e-9);
}

TEST_F(WatchStatisticsTest, DensityMayExceedTheIsovalueOnlyWhileEjecting) {
  client::PoseBatch message = Message(0, 0, 0);
  message.poses[0].density = 2.0;  // equal: on the surface
  Add(message);
  message.poses[0].density = std::nextafter(2.0, 3.0);
  message.poses[0].mode = client::ProxyMode::kEjecting;
  Add(message);
  EXPECT_EQ(At(0).inside_samples, 0u);
  message.poses[0].mode = client::ProxyMode::kConstrained;
  message.poses[0].contact = true;
  message.dropped = 9;
  Add(message);
  EXPECT_EQ(At(0).inside_samples, 1u);
  EXPECT_EQ(At(0).contact_samples, 1u);
  EXPECT_EQ(At(0).samples, 3u);
  EXPECT_EQ(At(0).dropped_samples, 9u);
}

TEST_F(WatchStatisticsTest, AgeGrowsWhileNothingComes) {
  Add(Message(1000, 0, 0), 5);
  EXPECT_NEAR(At(1005).age_ms, 5.0, 1e-9);
  EXPECT_NEAR(At(9000).age_ms, 8000.0, 1e-9);
  EXPECT_EQ(At(9000).recent_samples_per_s, 0.0);
}

TEST_F(WatchStatisticsTest, AgeBetweenMachinesLeavesTheirClocksOut) {
  WatchStatistics elsewhere(0, false);
  const std::int64_t offset = 123'456 * kMs;
  elsewhere.Add(Message(1000, 0, 0, 2.0), 1010 * kMs + offset);
  elsewhere.Add(Message(1001, 0, 0, 2.0), 1006 * kMs + offset);  // least delay: 3 ms
  EXPECT_NEAR(elsewhere.Figures(1006 * kMs + offset).age_ms, 2.0, 1e-9);
}

WatchStatus FullStatus() {
  WatchStatus status;
  status.server = "unix:/run/palpate/palpated.sock";
  status.pose = ContactPose();
  status.normalized_isovalue = 0.25;
  status.scp_h_world_mm = Vec3(-12.5, 80.0, 1234.0);
  status.max_force_n = 10.0;
  status.figures.seconds = 12.0;
  status.figures.recent_samples_per_s = 1000.0;
  status.figures.total_missed_ticks = 11;
  return status;
}

std::string Live(const WatchStatus& status) {
  return fmt::format("{}\n", fmt::join(LiveView(status, 79, 23), "\n"));
}

bool Shows(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(WatchViewTest, AStylusThatIsInsideIsToldWhatToDo) {
  WatchStatus status = FullStatus();
  status.pose->mode = client::ProxyMode::kInside;
  status.pose->contact = false;
  for (const std::string& text : {Live(status), LogLine(status)}) {
    EXPECT_TRUE(Shows(text, "pull out")) << text;
    EXPECT_FALSE(Shows(text, "fault")) << text;
  }
}

TEST(WatchViewTest, LiveViewShowsAllThatIsKnown) {
  const std::string text = Live(FullStatus());
  EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 23);
  for (const char* part :
       {"constrained, in contact", "5.000 N [###############               ] of 10 N",
        "isovalue -200 (normalised 0.2500)", "settings 7", "volume 3", "11 in all", "SCP_V",
        "in world  (-12.500000 80.000000 1234.000000)"}) {
    EXPECT_TRUE(Shows(text, part)) << part << "\n" << text;
  }
}

TEST(WatchViewTest, LinesFitTheTerminal) {
  for (int columns : {0, 1, 10, 40, 79}) {
    for (const std::string& line : LiveView(FullStatus(), columns, 23)) {
      int width = 0;
      for (const char c : line) {
        width += (static_cast<unsigned char>(c) & 0xc0) != 0x80;
      }
      EXPECT_LE(width, columns) << line;
    }
  }
  EXPECT_EQ(LiveView(FullStatus(), 79, 3).size(), 3u);
  EXPECT_TRUE(LiveView(FullStatus(), 79, -1).empty());
}

TEST(WatchViewTest, TheLogHasALineForEachStatus) {
  WatchStatus status = FullStatus();
  EXPECT_FALSE(Shows(LogLine(status), "\n"));
  EXPECT_TRUE(Shows(LogLine(status), "HIP (0.100 0.333 -2.500)"));
  EXPECT_TRUE(Shows(LogLine(status), "in world (-12.500000 80.000000 1234.000000) mm"));
  status.pose->scp_v_mm.reset();
  status.normalized_isovalue.reset();
  EXPECT_TRUE(Shows(LogLine(status), "SCP_V - mm")) << LogLine(status);
  EXPECT_FALSE(Shows(LogLine(status), "normalised"));
  EXPECT_TRUE(Shows(LogLine({}), "no sample yet"));
  EXPECT_EQ(LiveView({}, 79, 23).size(), 2u);
}

TEST(WatchViewTest, ShowsForcesThatAreNotOn) {
  WatchStatus status;
  status.pose.emplace();
  // An older daemon does not tell.
  EXPECT_FALSE(Shows(LogLine(status) + Live(status), "forces"));
  status.pose->forces = {client::ForceState::kOn, client::ForceReason::kNone, 3.3};
  EXPECT_FALSE(Shows(LogLine(status) + Live(status), "forces"));
  status.pose->forces = {client::ForceState::kStopped, client::ForceReason::kStopCall, 3.3};
  EXPECT_TRUE(Shows(LogLine(status), "forces stopped (stop call)")) << LogLine(status);
  EXPECT_TRUE(Shows(Live(status), "forces    stopped: ")) << Live(status);
}

TEST(WatchViewTest, SaysWhetherTheSampleIsOfNow) {
  WatchStatus status = FullStatus();
  const auto shows = [&](const std::string& what) {
    return Shows(LogLine(status), ": " + what) && Shows(Live(status), "shows     " + what);
  };
  EXPECT_TRUE(shows("live")) << LogLine(status);
  status.pose->replayed = true;
  EXPECT_TRUE(shows("replay: forces are off")) << LogLine(status);
  // Whatever the last sample was, it is not of now.
  status.figures.age_ms = 2300.0;
  EXPECT_TRUE(shows("old: ")) << LogLine(status);
  EXPECT_TRUE(Shows(LogLine(status), "2.3 s")) << LogLine(status);
  status.old_after_ms = 2400.0;
  EXPECT_TRUE(shows("replay: ")) << LogLine(status);
}

TEST(WatchViewTest, SummaryAddsTicksAndMisses) {
  WatchFigures figures;
  figures.samples = 4;
  figures.contact_samples = 1;
  figures.ticks_per_s = 998.9;
  figures.missed_per_s = 1.1;
  const std::string text = Summary(figures);
  EXPECT_TRUE(Shows(text, "= 1000.0/s")) << text;
  EXPECT_TRUE(Shows(text, "25.0 % of samples")) << text;
}

TEST(SampleJsonTest, KeepsEveryBit) {
  const Json json = Json::parse(ToText(ToJson(ContactPose())));
  EXPECT_EQ(json["tick"].get<std::uint64_t>(), 18446744073709551615u);
  EXPECT_EQ(json["time_ns"].get<std::int64_t>(), 9007199254740993);
  EXPECT_EQ(json["hip_mm"][1].get<double>(), 1.0 / 3.0);
  EXPECT_EQ(json["mode"], "constrained");
  EXPECT_EQ(json["contact"], true);
  EXPECT_EQ(json["stylus_orientation"], Json({1.0, 0.0, 0.0, 0.0}));
  EXPECT_EQ(json["scp_v_normal"], Json({0.0, 1.0, 0.0}));
  EXPECT_EQ(json["buttons"], 5);
  EXPECT_EQ(json["replayed"], false);
}

TEST(SampleJsonTest, AbsentAndNoNumberAreNull) {
  client::Pose pose;
  pose.density = std::numeric_limits<double>::quiet_NaN();
  const Json json = Json::parse(ToText(ToJson(pose)));
  for (const char* key : {"scp_v_mm", "scp_h_normal", "scp_v_normal", "density"}) {
    ASSERT_TRUE(json.contains(key)) << key;
    EXPECT_TRUE(json[key].is_null()) << key;
  }
}

TEST(WatchTest, BatchKeepsMessagesFew) {
  WatchOptions text;
  EXPECT_EQ(BatchFor(text, 1000.0), 32u);
  EXPECT_EQ(BatchFor(text, 10.0), 1u);
  text.count = 5;
  EXPECT_EQ(BatchFor(text, 1000.0), 5u);
  WatchOptions json;
  json.json = true;
  EXPECT_EQ(BatchFor(json, 60.0), 1u);
  EXPECT_EQ(BatchFor(json, 1000.0), 10u);
}

}  // namespace
}  // namespace palpate::cli
