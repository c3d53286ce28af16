// Pure parts of the command line client: statistics, views, JSON, wording.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/reach.h"
#include "client/cli/record_command.h"
#include "client/cli/sample_json.h"
#include "client/cli/set_command.h"
#include "client/cli/watch_command.h"
#include "client/cli/watch_statistics.h"
#include "client/cli/watch_view.h"
#include "client/sdk/setting_messages.h"
#include "common/error/one_line.h"
#include "tests/support/temporary_folder.h"

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

TEST(RecordCommandTest, DescribesARecording) {
  client::RecordingState state;
  state.path = "/data/a\n.palrec";
  EXPECT_EQ(DescribeRecording(state), "0 ticks (0.0 s), 0 lost, 0.0 MB, to /data/a .palrec");
  state.ticks = 60000;
  state.lost_ticks = 7;
  state.size_bytes = 6'180'000;
  EXPECT_EQ(DescribeRecording(state),
            "60000 ticks (60.0 s), 7 lost, 6.2 MB, 103 bytes per tick, to /data/a .palrec");
}

TEST(WatchStatisticsTest, NothingSeenGivesNoFigures) {
  const WatchStatistics statistics(0, true);
  const WatchFigures figures = statistics.Figures(2000 * kMs);
  EXPECT_EQ(figures.seconds, 2.0);
  EXPECT_EQ(figures.samples, 0u);
  EXPECT_EQ(figures.missed_percent, 0.0);
}

TEST(WatchStatisticsTest, RatesFollowTheClockOfTheLoop) {
  WatchStatistics statistics(0, true);
  // 900 ticks and 100 missed in each second of 5.
  for (std::uint64_t i = 0; i <= 5000; i += 10) {
    const std::uint64_t missed = i / 10;
    statistics.Add(Message(i - missed, missed, 1000), static_cast<std::int64_t>(i) * kMs);
  }
  const WatchFigures figures = statistics.Figures(5000 * kMs);
  EXPECT_EQ(figures.ticks, 4500u);
  EXPECT_EQ(figures.missed_ticks, 500u);
  EXPECT_NEAR(figures.ticks_per_s, 900.0, 1e-9);
  EXPECT_NEAR(figures.missed_per_s, 100.0, 1e-9);
  EXPECT_NEAR(figures.missed_percent, 10.0, 1e-9);
  EXPECT_NEAR(figures.recent_ticks_per_s, 900.0, 1e-9);
  EXPECT_NEAR(figures.recent_samples_per_s, 100.0, 1e-9);
  EXPECT_EQ(figures.total_missed_ticks, 500u);
}

TEST(WatchStatisticsTest, MissesBeforeTheWatchCountOnlyInTheTotal) {
  WatchStatistics statistics(0, true);
  statistics.Add(Message(1000, 1000, 1000), 2000 * kMs);
  statistics.Add(Message(2000, 1000, 1000), 3000 * kMs);
  const WatchFigures figures = statistics.Figures(3000 * kMs);
  EXPECT_EQ(figures.missed_ticks, 0u);
  EXPECT_EQ(figures.total_missed_ticks, 1000u);
  EXPECT_NEAR(figures.total_missed_percent, 100.0 / 3.0, 1e-9);
}

TEST(WatchStatisticsTest, UpdateTimesOfAllAndOfLate) {
  WatchStatistics statistics(0, true);
  // One update in fifty takes 1 ms, for 10 s; then all take 2 µs.
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const bool slow = i < 10000 && i % 50 == 0;
    statistics.Add(Message(i, 0, slow ? kMs : 2000), static_cast<std::int64_t>(i) * kMs);
  }
  const WatchFigures figures = statistics.Figures(20000 * kMs);
  EXPECT_NEAR(figures.update.mean_us, 2.0 + 998.0 * 0.01, 1e-6);
  EXPECT_NEAR(figures.update.max_us, 1000.0, 1e-9);
  // Exactly one in a hundred is slow: the 99th percentile is the last fast one.
  EXPECT_NEAR(figures.update.p99_us, 2.0, 0.11);
  EXPECT_NEAR(figures.recent_update.mean_us, 2.0, 1e-9);
  EXPECT_NEAR(figures.recent_update.max_us, 2.0, 1e-9);
}

TEST(WatchStatisticsTest, P99SeesWhatMoreThanOneInAHundredTakes) {
  WatchStatistics statistics(0, true);
  for (std::uint64_t i = 0; i < 1000; ++i) {
    statistics.Add(Message(i, 0, i % 50 == 0 ? 70'050 : 2000), static_cast<std::int64_t>(i));
  }
  const WatchFigures figures = statistics.Figures(1000);
  EXPECT_NEAR(figures.update.p99_us, 70.05, 0.1);
  EXPECT_NEAR(figures.recent_update.p99_us, 70.05, 1e-9);
}

TEST(WatchStatisticsTest, UpdateTimesBeyondTheHistogramAreKept) {
  WatchStatistics statistics(0, true);
  statistics.Add(Message(0, 0, 40 * kMs), 0);
  statistics.Add(Message(1, 0, -5), 0);
  EXPECT_NEAR(statistics.Figures(0).update.max_us, 40000.0, 1e-9);
}

TEST(WatchStatisticsTest, DensityMayExceedTheIsovalueOnlyWhileEjecting) {
  WatchStatistics statistics(0, true);
  client::PoseBatch message = Message(0, 0, 0);
  message.poses[0].density = 2.0;  // equal: on the surface
  statistics.Add(message, 0);
  message.poses[0].density = std::nextafter(2.0, 3.0);
  message.poses[0].mode = client::ProxyMode::kEjecting;
  statistics.Add(message, 0);
  EXPECT_EQ(statistics.Figures(0).inside_samples, 0u);
  message.poses[0].mode = client::ProxyMode::kConstrained;
  message.poses[0].contact = true;
  statistics.Add(message, 0);
  EXPECT_EQ(statistics.Figures(0).inside_samples, 1u);
  EXPECT_EQ(statistics.Figures(0).contact_samples, 1u);
}

TEST(WatchStatisticsTest, CountsWhatWasDropped) {
  WatchStatistics statistics(0, true);
  client::PoseBatch message = Message(0, 0, 0);
  message.dropped = 9;
  statistics.Add(message, 0);
  EXPECT_EQ(statistics.Figures(0).samples, 1u);
  EXPECT_EQ(statistics.Figures(0).dropped_samples, 9u);
}

TEST(WatchStatisticsTest, AgeGrowsWhileNothingComes) {
  WatchStatistics statistics(0, true);
  statistics.Add(Message(1000, 0, 0), 1005 * kMs);
  EXPECT_NEAR(statistics.Figures(1005 * kMs).age_ms, 5.0, 1e-9);
  EXPECT_NEAR(statistics.Figures(9000 * kMs).age_ms, 8000.0, 1e-9);
  EXPECT_EQ(statistics.Figures(9000 * kMs).recent_samples_per_s, 0.0);
}

TEST(WatchStatisticsTest, AgeBetweenMachinesLeavesTheirClocksOut) {
  WatchStatistics statistics(0, false);
  const std::int64_t offset = 123'456 * kMs;
  statistics.Add(Message(1000, 0, 0, 2.0), 1010 * kMs + offset);
  statistics.Add(Message(1001, 0, 0, 2.0), 1006 * kMs + offset);  // least delay: 3 ms
  EXPECT_NEAR(statistics.Figures(1006 * kMs + offset).age_ms, 2.0, 1e-9);
}

WatchStatus FullStatus() {
  WatchStatus status;
  status.server = "unix:/run/palpate/palpated.sock";
  status.pose = ContactPose();
  status.normalized_isovalue = 0.25;
  status.max_force_n = 10.0;
  status.figures.seconds = 12.0;
  status.figures.recent_samples_per_s = 1000.0;
  status.figures.total_missed_ticks = 11;
  return status;
}

std::string Joined(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) {
    text += line + "\n";
  }
  return text;
}

TEST(WatchViewTest, LiveViewShowsAllThatIsKnown) {
  const std::vector<std::string> lines = LiveView(FullStatus(), 79, 23);
  const std::string text = Joined(lines);
  EXPECT_LE(lines.size(), 23u);
  for (const char* part :
       {"constrained, in contact", "5.000 N [###############               ] of 10 N",
        "isovalue -200 (normalised 0.2500)", "settings 7", "volume 3", "11 in all", "SCP_V"}) {
    EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
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

TEST(WatchViewTest, AbsentProxyIsADash) {
  WatchStatus status = FullStatus();
  status.pose->scp_v_mm.reset();
  status.normalized_isovalue.reset();
  EXPECT_NE(LogLine(status).find("SCP_V - mm"), std::string::npos) << LogLine(status);
  EXPECT_EQ(LogLine(status).find("normalised"), std::string::npos);
}

TEST(WatchViewTest, NoSampleYet) {
  WatchStatus status;
  EXPECT_EQ(LiveView(status, 79, 23).size(), 2u);
  EXPECT_NE(LogLine(status).find("no sample yet"), std::string::npos);
}

TEST(WatchViewTest, LogLineIsOneLine) {
  EXPECT_EQ(LogLine(FullStatus()).find('\n'), std::string::npos);
  EXPECT_NE(LogLine(FullStatus()).find("HIP (0.100 0.333 -2.500)"), std::string::npos);
}

TEST(WatchViewTest, SummaryAddsTicksAndMisses) {
  WatchFigures figures;
  figures.samples = 4;
  figures.contact_samples = 1;
  figures.ticks_per_s = 998.9;
  figures.missed_per_s = 1.1;
  const std::string text = Summary(figures);
  EXPECT_NE(text.find("= 1000.0/s"), std::string::npos) << text;
  EXPECT_NE(text.find("25.0 % of samples"), std::string::npos) << text;
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
}

TEST(SampleJsonTest, AbsentIsNull) {
  const Json json = ToJson(client::Pose());
  for (const char* key : {"scp_v_mm", "scp_h_normal", "scp_v_normal"}) {
    ASSERT_TRUE(json.contains(key)) << key;
    EXPECT_TRUE(json[key].is_null()) << key;
  }
}

TEST(SampleJsonTest, NoNumberIsNull) {
  client::Pose pose;
  pose.density = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(Json::parse(ToText(ToJson(pose)))["density"].is_null());
}

TEST(DescriptionTest, TextFromElsewhereStaysOnItsLine) {
  client::VolumeInfo volume;
  volume.source = "evil\n\x1b[2Jname";
  const std::string text = Describe(volume);
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4);
}

TEST(DescriptionTest, PathsThatAreNotUtf8StillGiveJson) {
  client::VolumeInfo volume;
  volume.source = "/data/\xff.nrrd";
  EXPECT_TRUE(Json::accept(ToText(ToJson(volume))));
}

TEST(DescriptionTest, UnsetSettingsAreNull) {
  v1::RenderSettings message;
  message.set_isovalue(0.0);
  const Json json = ToJson(client::FromProto(message, 3));
  EXPECT_EQ(json["isovalue"], 0.0);
  EXPECT_TRUE(json["normalized_isovalue"].is_null());
  EXPECT_EQ(json["settings_revision"], 3);
}

TEST(SetTest, SaysWhatWasAppliedWhen) {
  client::SettingsResult result;
  result.settings.isovalue = 40.8;
  result.settings.normalized_isovalue = 0.16;
  result.settings.method = DecompositionMethod::kBcc;
  result.settings.revision = 7;
  result.applied_tick = 123456;
  result.receipt_to_applied_ns = 1'200'000;
  EXPECT_EQ(DescribeChange(client::kIsovalue, result),
            "isovalue 40.8 applied at tick 123456, settings revision 7, 1.2 ms after receipt");
  EXPECT_EQ(
      DescribeChange(client::kNormalizedIsovalue, result).rfind("isovalue 40.8 (normalised", 0),
      0u);
  EXPECT_EQ(DescribeChange(*FindSetting("method"), result).rfind("method bcc applied", 0), 0u);
}

TEST(ReachTest, ATokenThatOthersMayReadIsWarnedOf) {
  const test::TemporaryFolder folder;
  const std::string path = folder.path() / "token";
  std::ofstream(path) << "palpate_x\n";
  for (const auto& [mode, warns] : std::map<mode_t, bool>{
           {0600, false}, {0640, false}, {0660, false}, {0644, true}, {0604, true}}) {
    ASSERT_EQ(chmod(path.c_str(), mode), 0);
    const std::string warning = TokenFileWarning(path);
    EXPECT_EQ(!warning.empty(), warns) << mode;
    EXPECT_EQ(warning.find(path) != warning.npos, warns);
  }
  EXPECT_EQ(TokenFileWarning(""), "");
  EXPECT_EQ(TokenFileWarning(path + ".absent"), "");
}

TEST(PathsTest, RelativePathsBecomeAbsoluteOnTheSameMachineAlone) {
  for (const bool is_here : {true, false}) {
    EXPECT_EQ(PathThere("/data/a.nrrd", is_here, "or-2:7411"), "/data/a.nrrd");
    EXPECT_THROW(PathThere("", is_here, "or-2:7411"), Error);
  }
  EXPECT_EQ(PathThere("a.nrrd", true, "unix:/s"),
            (std::filesystem::current_path() / "a.nrrd").string());
  EXPECT_THROW(PathThere("a.nrrd", false, "or-2:7411"), Error);
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

TEST(OutputTest, ControlCharactersBecomeSpaces) {
  EXPECT_EQ(OneLine("a\nb\tc\x7f"), "a b c ");
  EXPECT_EQ(OneLine("N·s"), "N·s");
}

}  // namespace
}  // namespace palpate::cli
