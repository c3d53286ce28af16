// What a viewer knows of a real daemon, and what it asks of it.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <future>
#include <numeric>

#include "tests/support/excuse.h"
#include "tests/support/live_view.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::view {
namespace {

using namespace std::chrono_literals;
using client::ConnectionState;
using test::BricksOf;
using test::Eventually;
using test::Follow;
using test::RestartedDaemon;
using test::Settle;
using Clock = std::chrono::steady_clock;

class ViewLive : public ::testing::Test {
 protected:
  void SetUp() override { daemon_.Start(); }
  client::ServerChoice server() const { return {.address = {.socket_path = daemon_.socket()}}; }

  RestartedDaemon daemon_;
};

TEST_F(ViewLive, SeesVolumePoseAndSettings) {
  LiveFeed feed(server());
  EXPECT_FALSE(feed.pose() || feed.settings() || feed.stream_age_ms() || feed.volume().lattice());
  ASSERT_TRUE(Settle(feed));
  EXPECT_EQ(feed.connection().state, ConnectionState::kConnected);
  EXPECT_NE(feed.name().find(daemon_.socket()), std::string::npos);
  EXPECT_EQ(feed.volume().lattice()->size, Vec3i(48, 48, 48));
  EXPECT_TRUE(feed.volume().X_DI());
  EXPECT_TRUE(feed.volume_status().complete);
  const auto& counts = feed.volume().histogram().counts();
  EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}), 48u * 48 * 48);
  ASSERT_TRUE(feed.settings());
  EXPECT_NEAR(feed.volume().Interpolate(Vec3::Constant(-1)), feed.volume().lattice()->value_min,
              1e-6);

  const Vec3 hip = feed.pose()->hip_mm;
  EXPECT_TRUE(Follow(feed, [&] { return (feed.pose()->hip_mm - hip).norm() > 0.1; }));
  // All of them, however slow frames are.
  const std::size_t before = feed.plots().Times_ns().size();
  std::this_thread::sleep_for(1500ms);
  feed.Poll();
  EXPECT_GT(feed.plots().Times_ns().size(), before + 45) << test::kBusyMachine;
  EXPECT_TRUE(Follow(feed, [&] { return feed.plots().Greatest(Plot::kPenetration_mm) > 0.0f; }));
  EXPECT_GT(feed.plots().Greatest(Plot::kUpdate_us), 0.0f);
  EXPECT_GT(*feed.stream_age_ms(), 0.0);
  // The least, for the machine may be busy with other things.
  const auto ages = feed.plots().Values(Plot::kStreamAge_ms);
  const float least = *std::min_element(ages.begin(), ages.end());
  EXPECT_GT(least, 0.0f);
  EXPECT_LT(least, 50.0f) << test::kBusyMachine;
}

TEST_F(ViewLive, DisconnectsAndGoesToAnotherDaemon) {
  RestartedDaemon other({"--volume", "builtin:sphere:32"});
  other.Start();
  LiveFeed feed(server());
  ASSERT_TRUE(Follow(feed, [&] { return feed.volume().revision() && feed.pose(); }));
  const Vec3i size = feed.volume().lattice()->size;
  EXPECT_THROW(feed.Connect({.address = {.host_port = "nonsense"}}), Error);
  EXPECT_FALSE(feed.is_disconnected());
  feed.Disconnect();
  EXPECT_TRUE(feed.is_disconnected());
  EXPECT_EQ(feed.connection().state, client::ConnectionState::kLost);
  feed.commands().Do("a command", [](client::Client& client) { client.GetDevice(); });
  EXPECT_TRUE(Follow(feed, [&] { return !feed.commands().problem().empty(); }));
  EXPECT_EQ(feed.volume().lattice()->size, size);  // what was shown stays

  feed.Connect({.address = {.socket_path = other.socket()}});
  EXPECT_FALSE(feed.volume().lattice());  // nothing of the one before
  EXPECT_FALSE(feed.pose());
  ASSERT_TRUE(Follow(feed, [&] { return feed.volume().revision() && feed.pose(); }));
  EXPECT_EQ(feed.volume().lattice()->size, Vec3i(32, 32, 32));
  ASSERT_TRUE(Eventually([&] { return feed.role() == client::Role::kAdmin; }));
  EXPECT_TRUE(feed.May(client::Role::kOperator));
}

TEST(ViewQuestions, AreAnsweredInTheBackground) {
  const test::TemporaryFolder folder;
  const std::string config = folder.path() / "palpated.toml";
  std::ofstream(config) << "[volume]\nsave_folders = [\"" << folder.path().string() << "\"]\n";
  RestartedDaemon daemon({"--volume", "builtin:bumps:48", "--config", config});
  daemon.Start();
  LiveFeed feed({.address = {.socket_path = daemon.socket()}});
  ASSERT_TRUE(Eventually([&] { return feed.device() && feed.recording(); }));
  EXPECT_EQ(feed.device()->device.kind, "simulated");
  EXPECT_FALSE(feed.series());
  EXPECT_FALSE(feed.recording()->running);
  // Each begins when an answer has just come: the next would come a second later.
  constexpr int kRecordings = 6;
  const auto begin = Clock::now();
  for (int n = 0; n < kRecordings; ++n) {
    const std::string path = folder.path() / ("r" + std::to_string(n) + ".palprec");
    feed.DoAndAsk("record", [path](client::Client& client) { client.StartRecording(path); });
    ASSERT_TRUE(Eventually([&] { return feed.recording() && feed.recording()->running; }));
    EXPECT_EQ(feed.recording()->path, path);
    feed.DoAndAsk("stop", [](client::Client& client) { client.StopRecording(); });
    ASSERT_TRUE(Eventually([&] { return feed.recording() && !feed.recording()->running; }));
  }
  const auto took_ms = std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - begin);
  std::printf("%d answers in %d ms\n", 2 * kRecordings, static_cast<int>(took_ms.count()));
  EXPECT_LT(took_ms, kRecordings * 1s) << test::kBusyMachine;
  EXPECT_EQ(feed.commands().problem(), "");
  daemon.Kill();
  EXPECT_TRUE(Eventually([&] { return !feed.device() && !feed.recording(); }));
}

// A slider that is moved far faster than the daemon answers.
TEST_F(ViewLive, OfASliderTheLastValueCountsAndFewTravel) {
  constexpr int kSets = 5000;
  LiveFeed feed(server());
  ASSERT_TRUE(Follow(feed, [&] { return feed.settings().has_value(); }));
  const std::uint64_t before = feed.settings()->revision;
  feed.commands().Set({.stiffness_n_per_mm = 0.25});
  for (int n = 0; n <= kSets; ++n) {
    feed.commands().Set({.normalized_isovalue = 0.2 + 0.6 * n / kSets});
  }
  const VolumeLattice lattice = [&] {
    Follow(feed, [&] { return feed.volume().lattice().has_value(); });
    return *feed.volume().lattice();
  }();
  // The other way to say it replaces what waits.
  const double last = 0.3 * lattice.value_min + 0.7 * lattice.value_max;
  feed.commands().Set({.isovalue = last});
  ASSERT_TRUE(Follow(feed, [&] { return !feed.commands().busy(); }));
  EXPECT_EQ(feed.commands().problem(), "");
  client::Client other({.address = server().address});
  ASSERT_TRUE(other.WaitUntilConnected(60s));
  const client::Settings settings = other.GetSettings();
  EXPECT_NEAR(settings.isovalue, last, 1e-9);
  EXPECT_EQ(settings.stiffness_n_per_mm, 0.25);
  std::printf("%d sets travelled as %d\n", kSets + 2, static_cast<int>(settings.revision - before));
  EXPECT_GE(settings.revision - before, 1u);
  EXPECT_LT(settings.revision - before, kSets / 10u) << test::kBusyMachine;
  EXPECT_TRUE(Follow(feed, [&] { return feed.settings()->revision == settings.revision; }));
}

TEST_F(ViewLive, CommandsKeepTheirOrderAndSayWhatWentWrong) {
  client::Client client({.address = server().address});
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  std::vector<int> order;
  std::promise<void> begun, go;
  std::thread later;
  {
    Commands commands(client);
    EXPECT_FALSE(commands.busy());
    for (int n = 0; n < 100; ++n) {
      commands.Set({.viscosity_n_s_per_m = 0.01 * n});
      commands.Do("count", [&order, n](client::Client&) { order.push_back(n); });
    }
    EXPECT_TRUE(commands.busy());
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem(), "");
    commands.Do("undo", [](client::Client& c) { c.Undo(); });
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem().rfind("undo: ", 0), 0u) << commands.problem();
    EXPECT_GT(commands.problem().size(), 10u);
    commands.Set({.stiffness_n_per_mm = 1e9});
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_NE(commands.problem().find("stiffness"), std::string::npos) << commands.problem();
    commands.Do("throw", [](client::Client&) { throw std::runtime_error("what is no Error"); });
    commands.Do("look", [](client::Client& c) { c.GetSettings(); });
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem(), "");

    // What is not begun when it ends is dropped.
    commands.Do("wait", [&](client::Client&) {
      begun.set_value();
      go.get_future().wait();
    });
    commands.Do("count", [&order](client::Client&) { order.push_back(-1); });
    begun.get_future().wait();
    // When the destructor waits for it.
    later = std::thread([&go] {
      std::this_thread::sleep_for(500ms);
      go.set_value();
    });
  }
  later.join();
  ASSERT_EQ(order.size(), 100u);
  EXPECT_TRUE(std::is_sorted(order.begin(), order.end()));
}

// Not for ever: who reads it later would look for what is wrong now.
TEST_F(ViewLive, AProblemIsSaidForAWhile) {
  LiveFeed feed(server());
  ASSERT_TRUE(Follow(feed, [&] { return feed.settings().has_value(); }));
  const auto begin = Clock::now();
  feed.commands().Do("undo", [](client::Client& client) { client.Undo(); });
  ASSERT_TRUE(Follow(feed, [&] { return !feed.commands().problem().empty(); }));
  EXPECT_TRUE(Follow(feed, [&] { return feed.commands().problem().empty(); }));
  EXPECT_GE(Clock::now() - begin, Commands::kProblemTime);
  // The next one is said again.
  feed.commands().Do("undo", [](client::Client& client) { client.Undo(); });
  EXPECT_TRUE(Follow(feed, [&] { return !feed.commands().problem().empty(); }));
}

// Whether an update has every setting of the list.
bool HasAll(const client::SettingsUpdate& update) {
  const auto has = [&update](const auto& kind) {
    if constexpr (requires { kind.updated; }) {
      return kind.updated(update).has_value();
    } else {
      return (update.*kind.update).has_value();
    }
  };
  return std::all_of(client::kSettings.begin(), client::kSettings.end(),
                     [&](const client::Setting& s) { return std::visit(has, s.kind); });
}

TEST(ViewCommands, EverySettingIsMerged) {
  client::SettingsUpdate newer, waiting;
  const auto put = [&newer](const auto& kind) {
    if constexpr (requires { kind.updated; }) {
      kind.update(newer, kind.words.size() - 1);
    } else {
      (newer.*kind.update).emplace();
    }
  };
  for (const client::Setting& setting : client::kSettings) {
    EXPECT_FALSE(HasAll(newer)) << setting.key;
    std::visit(put, setting.kind);
  }
  newer.expected_revision = 1;
  Merge(newer, waiting);
  EXPECT_TRUE(HasAll(waiting));
  EXPECT_EQ(waiting.free_side, client::FreeSide::kAbove);
  Merge({}, waiting);
  EXPECT_TRUE(HasAll(waiting));
  EXPECT_EQ(waiting.expected_revision, 1u);
  Merge({.isovalue = 3.0, .stiffness_n_per_mm = 0.5}, waiting);
  EXPECT_EQ(waiting.isovalue, 3.0);
  EXPECT_FALSE(waiting.normalized_isovalue);
  EXPECT_EQ(waiting.stiffness_n_per_mm, 0.5);
  Merge({.normalized_isovalue = 0.25}, waiting);
  EXPECT_FALSE(waiting.isovalue);
}

// Frames go on, and the end is near, however long the daemon does not answer.
TEST_F(ViewLive, WaitsForNothingWhileTheDaemonHangs) {
  auto feed = std::make_unique<LiveFeed>(server());
  ASSERT_TRUE(Settle(*feed));
  daemon_.Hang();
  const auto begin = Clock::now();
  for (int n = 0; n < 1000; ++n) {
    feed->commands().Set({.stiffness_n_per_mm = 0.1 + 1e-4 * n});
    feed->commands().Do("look", [](client::Client& client) { client.GetSettings(); });
    feed->Poll();
    feed->commands().problem();
    feed->device();
  }
  // A single call would wait for 5 s.
  EXPECT_LT(Clock::now() - begin, 3s) << test::kBusyMachine;
  EXPECT_TRUE(feed->commands().busy());
  const auto end = Clock::now();
  feed.reset();
  EXPECT_LT(Clock::now() - end, 3s) << test::kBusyMachine;
  daemon_.Continue();
}

// The slider of a series that is moved on while nothing answers: what was overtaken is
// never sent, each of which would take its 5 s.
TEST_F(ViewLive, OfASeriesTheNewestPositionIsSent) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  daemon_.Hang();
  const auto begin = Clock::now();
  for (int n = 0; n < 50; ++n) feed.ControlSeries({.position_frames = 0.1 * n});
  feed.ControlSeries({.playing = true});
  EXPECT_TRUE(Follow(feed, [&] { return !feed.commands().busy(); }));
  EXPECT_LT(Clock::now() - begin, 30s);
  EXPECT_EQ(feed.commands().problem().rfind("series: ", 0), 0u);
  daemon_.Continue();
}

TEST_F(ViewLive, ComesBackAfterTheDaemonWasKilled) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  const std::vector<Brick> loaded = BricksOf(feed.volume());
  const std::uint64_t daemon_id = feed.volume().revision()->daemon_id;
  client::Edit edit;
  edit.shape = client::Sphere{Vec3(24, 24, 24), 6.0};
  edit.frame = client::EditFrame::kIndex;
  edit.operation = client::EditOperation::kSet;
  edit.value = 0.375 * feed.volume().lattice()->value_max;
  feed.commands().Do("edit", [edit](client::Client& client) { client.Apply(edit); });
  ASSERT_TRUE(Settle(feed));
  EXPECT_TRUE(BricksOf(feed.volume()) != loaded);
  for (int round = 0; round < 2; ++round) {
    daemon_.Kill();
    ASSERT_TRUE(Follow(feed, [&] { return feed.connection().state == ConnectionState::kLost; }));
    EXPECT_NE(feed.connection().why, "");
    feed.commands().Set({.stiffness_n_per_mm = 0.125});
    ASSERT_TRUE(Follow(feed, [&] { return !feed.commands().busy(); }));
    EXPECT_EQ(feed.commands().problem().rfind("settings: ", 0), 0u);
    daemon_.Start();
    ASSERT_TRUE(
        Follow(feed, [&] { return feed.connection().state == ConnectionState::kConnected; }));
    // The edit went with the daemon that had it.
    ASSERT_TRUE(Settle(feed));
    EXPECT_NE(feed.volume().revision()->daemon_id, daemon_id);
    EXPECT_TRUE(BricksOf(feed.volume()) == loaded);
    feed.commands().Set({.stiffness_n_per_mm = 0.375});
    ASSERT_TRUE(Follow(feed, [&] {
      return feed.settings() && feed.settings()->stiffness_n_per_mm == 0.375;
    })) << feed.commands().problem();
  }
}

// It looks connected, but what is shown gets old.
TEST_F(ViewLive, ADaemonThatHangsIsSilent) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  EXPECT_TRUE(Follow(feed, [&] { return !feed.silent_s(); }));
  daemon_.Hang();
  ASSERT_TRUE(Follow(feed, [&] { return feed.silent_s() > 1.0; }));
  EXPECT_EQ(feed.connection().state, ConnectionState::kConnected);
  // Nor do old curves stay: they move on, and out.
  const auto first_ns = feed.plots().Times_ns().front();
  EXPECT_TRUE(Follow(feed, [&] {
    return feed.plots().Times_ns().empty() || feed.plots().Times_ns().front() > first_ns;
  }));
  daemon_.Continue();
  EXPECT_TRUE(Follow(feed, [&] { return !feed.silent_s(); }));
  daemon_.Kill();
  ASSERT_TRUE(Follow(feed, [&] { return feed.connection().state == ConnectionState::kLost; }));
  EXPECT_FALSE(feed.silent_s());
}

TEST_F(ViewLive, AnEmergencyStopIsSaidWhenItIsDone) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  EXPECT_EQ(feed.emergency_stop().line().text, "");
  daemon_.Hang();
  for (int n = 0; n < 100; ++n) feed.emergency_stop().Send();
  EXPECT_TRUE(feed.emergency_stop().line().is_bad);
  EXPECT_NE(feed.emergency_stop().line().text.find("not answered"), std::string::npos);
  daemon_.Continue();
  ASSERT_TRUE(Follow(feed, [&] { return !feed.emergency_stop().line().is_bad; }));
  EXPECT_NE(feed.emergency_stop().line().text.find("forces are off"), std::string::npos);
  EXPECT_TRUE(
      Follow(feed, [&] { return feed.pose()->forces.state == client::ForceState::kStopped; }));

  daemon_.Kill();
  ASSERT_TRUE(Follow(feed, [&] { return feed.connection().state == ConnectionState::kLost; }));
  // That was of the daemon before.
  EXPECT_EQ(feed.emergency_stop().line().text, "");
  feed.emergency_stop().Send();
  const auto failed = [&] {
    return feed.emergency_stop().line().text.find("NOT sent") != std::string::npos;
  };
  ASSERT_TRUE(Follow(feed, failed));
  EXPECT_TRUE(feed.emergency_stop().line().is_bad);
  daemon_.Start();
  EXPECT_TRUE(Follow(feed, [&] { return feed.emergency_stop().line().text.empty(); }));
}

double ResidentMib() {
  std::ifstream file("/proc/self/statm");
  double size = 0, resident = 0;
  file >> size >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

// What piles up is in the youngest too, and a machine that halts is not.
double Least(const std::vector<double>& values) {
  return *std::min_element(values.begin(), values.end());
}

// 20 s of frames against a hand that moves, with edits and settings between.
TEST_F(ViewLive, DoesNotGrowWithTime) {
  constexpr int kFrames = 1200, kWarm = 300;
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  double warm_mib = 0.0;
  std::vector<double> first_ages, last_ages;
  auto next = Clock::now();
  for (int frame = 0; frame < kFrames; ++frame) {
    std::this_thread::sleep_until(next += std::chrono::microseconds(16667));
    feed.Poll();
    feed.volume().TakeChanges();
    feed.commands().Set({.normalized_isovalue = 0.4 + 0.0001 * (frame % 1000)});
    if (frame % 10 == 0) {
      client::Edit edit;
      edit.shape = client::Sphere{Vec3::Constant(10 + frame / 10 % 28), 4.0};
      edit.frame = client::EditFrame::kIndex;
      edit.value = frame % 20 == 0 ? 0.1 : -0.1;
      feed.commands().Do("edit", [edit](client::Client& client) { client.Apply(edit); });
    }
    if (frame == kWarm) warm_mib = ResidentMib();
    if (frame >= kWarm && frame < 2 * kWarm) first_ages.push_back(*feed.stream_age_ms());
    if (frame >= kFrames - kWarm) last_ages.push_back(*feed.stream_age_ms());
  }
  const double end_mib = ResidentMib();
  EXPECT_EQ(feed.commands().problem(), "");
  const auto times_ns = feed.plots().Times_ns();
  const double span_s = 1e-9 * static_cast<double>(times_ns.back() - times_ns.front());
  EXPECT_NEAR(span_s, 10.0, 0.5);
  // 600, less what a busy machine dropped.
  EXPECT_GT(times_ns.size(), 300u) << test::kBusyMachine;
  std::printf("%.1f MiB, later %.1f MiB; least age %.1f ms, later %.1f ms; %d dropped\n", warm_mib,
              end_mib, Least(first_ages), Least(last_ages), static_cast<int>(feed.dropped_poses()));
#ifndef PALPATE_SANITIZED  // which keeps what was freed for a while
  EXPECT_LT(end_mib, warm_mib + 8.0);
#endif
  EXPECT_LT(Least(last_ages), 2.0 * Least(first_ages) + 20.0) << test::kBusyMachine;
  EXPECT_TRUE(Settle(feed));
}

}  // namespace
}  // namespace palpate::view
