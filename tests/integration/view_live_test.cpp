// What a viewer knows of a real daemon, and what it asks of it.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <future>
#include <numeric>

#include "client/sdk/messages.h"
#include "tests/support/live_view.h"
#include "tests/support/refusal.h"
#include "tests/support/restarted_daemon.h"
#include "tests/support/stolen.h"

namespace palpate::view {
namespace {

using namespace std::chrono_literals;
using client::ConnectionState;
using test::BricksOf;
using test::Eventually;
using test::Follow;
using test::RestartedDaemon;
using test::Settle;

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
  const std::size_t before = feed.plots().Times_ns().size();
  EXPECT_TRUE(Follow(feed, [&] { return feed.plots().Times_ns().size() > before + 45; }));
  EXPECT_TRUE(Follow(feed, [&] { return feed.plots().Greatest(Plot::kPenetration_mm) > 0.0f; }));
  EXPECT_GT(feed.plots().Greatest(Plot::kUpdate_us), 0.0f);
  EXPECT_GT(*feed.stream_age_ms(), 0.0);
  const auto ages = feed.plots().Values(Plot::kStreamAge_ms);
  EXPECT_GT(*std::min_element(ages.begin(), ages.end()), 0.0f);
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
  ASSERT_TRUE(Follow(feed, [&] { return feed.role() == client::Role::kAdmin; }));
  EXPECT_TRUE(feed.May(client::Role::kOperator));
}

// The names that activity.proto lists, as far as the feed changes these things itself.
TEST_F(ViewLive, KnowsItsOwnChangesOfWhatIsForEveryone) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  struct Thing {
    const char* name;
    std::function<void()> change;
  };
  const Thing things[] = {
      {"forces", [&] { feed.DisableForces(); }},
      {"forces", [&] { feed.EnableForces({}); }},
      {"forces", [&] { feed.StopForces(); }},
      {"recording", [&] { feed.StartRecording(daemon_.folder() / "own.mcap"); }},
      {"recording", [&] { feed.StopRecording(); }},
      {"volume", [&] { feed.loader().Load("builtin:sphere:16", false); }},
      {"hand",
       [&] {
         feed.TakeHand();
         feed.hand()->MoveTo(feed.pose()->hip_mm);
       }},
  };
  for (const Thing& thing : things) {
    SCOPED_TRACE(thing.name);
    const auto before = std::chrono::steady_clock::now();
    thing.change();
    std::optional<SharedThings::Change> change;
    ASSERT_TRUE(Follow(feed, [&] {
      const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - before;
      change = feed.shared().Of(thing.name);
      return change && change->age_s < passed.count();
    }));
    EXPECT_TRUE(change->is_own);
    EXPECT_FALSE(change->is_fresh);
    feed.loader().TakeOutcome();
  }
  EXPECT_EQ(feed.shared().FreshLine(), "");
}

class ViewFacts : public ViewLive {
 protected:
  // Begins and ends a recording, and waits until the feed knows both.
  void Record(const std::string& name) {
    const std::string path = daemon_.folder() / name;
    feed_.StartRecording(path);
    ASSERT_TRUE(Follow(feed_, [&] { return feed_.recording() && feed_.recording()->running; }));
    EXPECT_EQ(feed_.recording()->path, path);
    feed_.StopRecording();
    ASSERT_TRUE(Follow(feed_, [&] { return feed_.recording() && !feed_.recording()->running; }));
    EXPECT_EQ(feed_.commands().problem(), "");
  }

  LiveFeed feed_{server()};
};

TEST_F(ViewFacts, AreKnownWithoutAsking) {
  ASSERT_TRUE(Follow(feed_, [&] { return feed_.device() && feed_.recording(); }));
  EXPECT_EQ(feed_.device()->device.kind, "simulated");
  EXPECT_FALSE(feed_.series());
  EXPECT_FALSE(feed_.recording()->running);
  Record("a.mcap");
  daemon_.Kill();
  EXPECT_TRUE(Follow(feed_, [&] { return !feed_.device() && !feed_.recording(); }));
}

// Of a slider that is moved far faster than the daemon answers. Here it answers when `go` is set.
TEST_F(ViewLive, OfASliderOnlyTheLastValueTravels) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  const std::uint64_t before = feed.settings()->revision;
  std::promise<void> go;
  feed.commands().Do("wait", [&go](client::Client&) { go.get_future().wait(); });
  feed.commands().Set({.stiffness_n_per_mm = 0.25});
  for (int n = 0; n <= 5000; ++n) feed.commands().Set({.normalized_isovalue = 0.2 + 1e-4 * n});
  const VolumeLattice lattice = *feed.volume().lattice();
  // The other way to say it replaces what waits.
  const double last = 0.3 * lattice.value_min + 0.7 * lattice.value_max;
  feed.commands().Set({.isovalue = last});
  go.set_value();
  ASSERT_TRUE(Follow(feed, [&] { return !feed.commands().busy(); }));
  EXPECT_EQ(feed.commands().problem(), "");
  client::Client other({.address = server().address});
  ASSERT_TRUE(other.WaitUntilConnected(60s));
  const client::Settings settings = other.GetSettings();
  EXPECT_NEAR(settings.isovalue, last, 1e-9);
  EXPECT_EQ(settings.stiffness_n_per_mm, 0.25);
  // The first value may be on its way before the queue waits.
  EXPECT_LE(settings.revision - before, 2u);
  EXPECT_TRUE(Follow(feed, [&] { return feed.settings()->revision == settings.revision; }));
}

TEST_F(ViewLive, CommandsKeepTheirOrderAndSayWhatWentWrong) {
  client::Client client({.address = server().address});
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  std::vector<int> order;
  std::atomic<int> dropped{1000};
  std::promise<void> begun;
  {
    Commands commands(client);
    EXPECT_FALSE(commands.busy());
    std::promise<void> go;
    commands.Do("wait", [&go](client::Client&) { go.get_future().wait(); });
    for (int n = 0; n < 100; ++n) {
      commands.Set({.viscosity_n_s_per_m = 0.01 * n});
      commands.Do("count", [&order, n](client::Client&) { order.push_back(n); });
    }
    EXPECT_TRUE(commands.busy());
    go.set_value();
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem(), "");
    commands.Do("undo", [](client::Client& c) { c.Undo(); });
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem().rfind("undo: ", 0), 0u) << commands.problem();
    commands.Set({.stiffness_n_per_mm = 1e9});
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem().rfind("settings: ", 0), 0u) << commands.problem();
    EXPECT_NE(commands.problem().find("stiffness"), std::string::npos) << commands.problem();
    commands.Do("throw", [](client::Client&) { throw std::runtime_error("what is no Error"); });
    commands.Do("look", [](client::Client& c) { c.GetSettings(); });
    ASSERT_TRUE(Eventually([&] { return !commands.busy(); }));
    EXPECT_EQ(commands.problem(), "");

    // What is not begun when it ends is dropped. More waits than is begun before the destructor.
    commands.Do("wait", [&](client::Client&) { begun.set_value(); });
    for (int n = 0; n < 1000; ++n) {
      commands.Do("wait", [&dropped](client::Client&) {
        --dropped;
        std::this_thread::sleep_for(10ms);
      });
    }
    begun.get_future().wait();
  }
  EXPECT_GT(dropped, 0);
  ASSERT_EQ(order.size(), 100u);
  EXPECT_TRUE(std::is_sorted(order.begin(), order.end()));
}

// Not for ever: who reads it later would look for what is wrong now.
TEST_F(ViewLive, AProblemIsSaidForAWhile) {
  LiveFeed feed(server());
  ASSERT_TRUE(Follow(feed, [&] { return feed.settings().has_value(); }));
  feed.commands().Do("undo", [](client::Client& client) { client.Undo(); });
  ASSERT_TRUE(Follow(feed, [&] { return !feed.commands().problem().empty(); }));
  EXPECT_TRUE(Follow(feed, [&] { return feed.commands().problem().empty(); }));
  // The next one is said again.
  feed.commands().Do("undo", [](client::Client& client) { client.Undo(); });
  EXPECT_TRUE(Follow(feed, [&] { return !feed.commands().problem().empty(); }));
}

std::size_t CountSettings(const client::SettingsUpdate& update) {
  return ToProto(update).update_mask().paths_size();
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
  for (const client::Setting& setting : client::kSettings) std::visit(put, setting.kind);
  newer.layers.emplace();
  newer.tool.emplace();
  newer.expected_revision = 1;
  Merge(newer, waiting);
  EXPECT_EQ(CountSettings(waiting), client::kSettings.size() + 2);
  EXPECT_EQ(waiting.free_side, client::FreeSide::kAbove);
  Merge({}, waiting);
  EXPECT_EQ(CountSettings(waiting), client::kSettings.size() + 2);
  EXPECT_EQ(waiting.expected_revision, 1u);
  Merge({.isovalue = 3.0, .stiffness_n_per_mm = 0.5}, waiting);
  EXPECT_EQ(waiting.isovalue, 3.0);
  EXPECT_FALSE(waiting.normalized_isovalue);
  EXPECT_EQ(waiting.stiffness_n_per_mm, 0.5);
  Merge({.normalized_isovalue = 0.25}, waiting);
  EXPECT_FALSE(waiting.isovalue);
}

// Frames go on however long the daemon does not answer: each of these calls would wait for 5 s.
TEST_F(ViewLive, WaitsForNothingWhileTheDaemonHangs) {
  auto feed = std::make_unique<LiveFeed>(server());
  ASSERT_TRUE(Settle(*feed));
  daemon_.Hang();
  std::promise<void> begun;
  std::optional<ErrorKind> ended;
  feed->commands().Do("load", [&](client::Client& client) {
    begun.set_value();
    ended = testing::Refusal([&] { client.LoadVolume("builtin:sphere:32"); });
  });
  begun.get_future().wait();
  for (int n = 0; n < 1000; ++n) {
    feed->commands().Set({.stiffness_n_per_mm = 0.1 + 1e-4 * n});
    feed->commands().Do("look", [](client::Client& client) { client.GetSettings(); });
    feed->Poll();
    feed->commands().problem();
    feed->device();
  }
  EXPECT_TRUE(feed->commands().busy());
  // Nor does the end wait, also for a call without a deadline.
  feed.reset();
  EXPECT_EQ(ended, ErrorKind::kCancelled);
  daemon_.Continue();
}

// The slider of a series that is moved on while nothing answers. What was overtaken is never sent:
// each would take its 5 s, and all together far more than Follow's patience.
TEST_F(ViewLive, OfASeriesTheNewestPositionIsSent) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  daemon_.Hang();
  for (int n = 0; n < 50; ++n) feed.ControlSeries({.position_frames = 0.1 * n});
  feed.ControlSeries({.playing = true});
  EXPECT_TRUE(Follow(feed, [&] { return !feed.commands().busy(); }));
  EXPECT_EQ(feed.commands().problem().rfind("series: ", 0), 0u);
  daemon_.Continue();
}

// It looks connected, but what is shown gets old.
TEST_F(ViewLive, ADaemonThatHangsIsSilent) {
  LiveFeed feed(server());
  ASSERT_TRUE(Settle(feed));
  EXPECT_TRUE(Follow(feed, [&] { return !feed.silent_s(); }));
  daemon_.Hang();
  // None once it counts as lost.
  ASSERT_TRUE(Follow(feed, [&] { return feed.silent_s() > 1.0; }));
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
  for (int n = 0; n < 100; ++n) feed.StopForces();
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
  feed.StopForces();
  const auto failed = [&] {
    return feed.emergency_stop().line().text.find("NOT confirmed") != std::string::npos;
  };
  ASSERT_TRUE(Follow(feed, failed));
  EXPECT_TRUE(feed.emergency_stop().line().is_bad);
  daemon_.Start();
  EXPECT_TRUE(Follow(feed, [&] { return feed.emergency_stop().line().text.empty(); }));
}

}  // namespace
}  // namespace palpate::view
