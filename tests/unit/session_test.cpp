// A session under a running servo loop, and the newest tick.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/pump/tick_outbox.h"
#include "server/session/edits/volume_editor.h"
#include "server/session/session.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/running_session.h"
#include "tests/support/setting_choice.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;
using testing::Choice;
using testing::kNever;
using testing::kQuiet;
using testing::Refusal;

class SessionTest : public ::testing::Test, protected testing::RunningSession {
 protected:
  void SetUp() override {
    Load("builtin:sphere:32");
    Start();
  }
};

TEST_F(SessionTest, AnUpdateIsAppliedAtATick) {
  const SettingsApplied a = session().Update({.isovalue = 0.4});
  const SettingsApplied b = session().Update({.normalized_isovalue = 0.6});
  EXPECT_EQ(a.state.settings.isovalue, 0.4);
  EXPECT_NEAR(b.state.settings.normalized_isovalue, 0.6, 1e-12);
  EXPECT_EQ(b.state.settings_revision, a.state.settings_revision + 1);
  EXPECT_GT(b.applied.tick, a.applied.tick);
}

TEST_F(SessionTest, BadUpdatesChangeNothing) {
  const SettingsState before = session().settings();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const SettingsUpdate& bad :
       {SettingsUpdate{.isovalue = 1.5}, SettingsUpdate{.isovalue = nan},
        SettingsUpdate{.normalized_isovalue = -0.1},
        SettingsUpdate{.isovalue = 0.5, .normalized_isovalue = 0.5},
        SettingsUpdate{.isovalue = 0.6, .numbers = {{&HapticSettings::pop_force_n, 100.0}}},
        SettingsUpdate{.numbers = {{&HapticSettings::damping_n_s_per_m, 1.0},
                                   {&HapticSettings::magnet_range_mm, nan}},
        .flags = {{&HapticSettings::force_shading, true}},
        .choices = {Choice("free_side", FreeSide::kAbove)}}}) {
    EXPECT_EQ(Refusal([&] { session().Update(bad); }), ErrorKind::kInvalidArgument);
  }
  for (const std::uint64_t other : {before.settings_revision - 1, before.settings_revision + 1}) {
    EXPECT_EQ(Refusal([&] { session().Update({.isovalue = 0.5, .expected_revision = other}); }),
              ErrorKind::kConflict);
  }
  EXPECT_EQ(session().settings().settings_revision, before.settings_revision);
  EXPECT_EQ(session().settings().settings.isovalue, before.settings.isovalue);
  EXPECT_EQ(session().settings().settings.haptics.damping_n_s_per_m, 0.0);
  EXPECT_FALSE(session().settings().settings.haptics.force_shading);
  EXPECT_EQ(session().settings().settings.haptics.free_side, FreeSide::kBelow);
}

TEST_F(SessionTest, EveryNumberHasARangeThatNamesItsKeyAndUnit) {
  for (const NumberSetting& setting : kNumberSettings) {
    SCOPED_TRACE(setting.key);
    // Down at last: a static friction below the dynamic one is allowed.
    for (const double good : {setting.high, setting.low}) {
      // Its greatest value depends on the volume, too.
      if (setting.member == &HapticSettings::tool_radius_mm && good > 0.0) continue;
      const SettingsApplied applied = session().Update({.numbers = {{setting.member, good}}});
      EXPECT_EQ(applied.state.settings.haptics.*setting.member, good);
    }
    for (const double bad : {std::nextafter(setting.high, HUGE_VAL), -HUGE_VAL, HUGE_VAL,
                             std::nextafter(setting.low, -HUGE_VAL), std::nan("")}) {
      const std::string text = testing::Complaint([&] {
        session().Update({.numbers = {{setting.member, bad}}});
      });
      EXPECT_TRUE(text.starts_with(setting.key)) << bad << ": " << text;
      EXPECT_TRUE(text.ends_with(setting.unit)) << text;
    }
    EXPECT_EQ(session().settings().settings.haptics.*setting.member, setting.low);
  }
}

TEST_F(SessionTest, FlagsAndTheFreeSideComeAndGo) {
  for (const bool on : {true, false}) {
    const FreeSide side = on ? FreeSide::kAbove : FreeSide::kBelow;
    SettingsUpdate update{.choices = {Choice("free_side", side)}};
    for (const FlagSetting& setting : kFlagSettings) update.flags.emplace_back(setting.member, on);
    const HapticSettings haptics = session().Update(update).state.settings.haptics;
    for (const FlagSetting& setting : kFlagSettings) {
      EXPECT_EQ(haptics.*setting.member, on) << setting.key;
    }
    EXPECT_EQ(haptics.free_side, side);
  }
}

TEST_F(SessionTest, BadSettingsToStartWithAreRefused) {
  EXPECT_EQ(Refusal([&] { session().SetInitial({.haptics = {.magnet_force_n = 1.6}}); }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(session().settings().settings.haptics.magnet_force_n, 0.0);
}

TEST_F(SessionTest, AFailedLoadKeepsTheVolume) {
  const VolumeState before = session().volume();
  for (const LoadRequest& bad :
       {LoadRequest{.source = "builtin:cube"}, LoadRequest{.source = "relative.nrrd"},
        LoadRequest{.source = "builtin:bumps:16", .isovalue = 7.0},
        LoadRequest{.source = "builtin:bumps:16", .device_mm_per_volume_mm = -1.0},
        LoadRequest{.source = "builtin:bumps:16", .device_mm_per_volume_mm = 1e-300},
        LoadRequest{.source = "builtin:bumps:16", .device_mm_per_volume_mm = 1e300},
        LoadRequest{.source = "builtin:bumps:16", .spacing_mm = Vec3(0, 1, 1)}}) {
    EXPECT_EQ(Refusal([&] { session().Load(bad, kQuiet, kNever); }), ErrorKind::kInvalidArgument)
        << bad.source;
  }
  EXPECT_EQ(session().volume().volume, before.volume);
  EXPECT_EQ(session().volume().settings_revision, before.settings_revision);
}

struct SeenScenes final : SceneListener {
  void OnScene(const Scene& scene, std::span<const BrickChange>) override {
    volumes.push_back(scene.volume->revision());
    isovalues.push_back(scene.isovalue);
    settings.push_back(scene.settings);
  }
  std::vector<std::uint64_t> volumes{};
  std::vector<double> isovalues{};
  std::vector<HapticSettings> settings{};
};

TEST_F(SessionTest, ALoadBringsItsSettingsInOneScene) {
  SeenScenes seen;
  const Listening listening(session(), seen);
  const SettingsState before = session().settings();
  const auto load = [&](const LoadRequest& request, const SettingsUpdate& settings) {
    return session().Load(request, kQuiet, kNever, settings);
  };
  const LoadRequest bumps{.source = "builtin:bumps:32"};
  const std::pair<double HapticSettings::*, double> soft{&HapticSettings::stiffness_n_per_mm, 0.2};
  for (const SettingsUpdate& bad :
       {SettingsUpdate{.numbers = {soft, {&HapticSettings::pop_force_n, 100.0}}},
        SettingsUpdate{.isovalue = 99.0, .numbers = {soft}},
        SettingsUpdate{.isovalue = 0.5, .normalized_isovalue = 0.5, .numbers = {soft}}}) {
    EXPECT_EQ(Refusal([&] { load(bumps, bad); }), ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(Refusal([&] {
              load({.source = bumps.source, .isovalue = 0.5}, {.normalized_isovalue = 0.5});
            }),
            ErrorKind::kInvalidArgument);
  EXPECT_TRUE(seen.volumes.empty());
  EXPECT_EQ(session().settings().settings_revision, before.settings_revision);

  const VolumeState state = load(bumps, {.isovalue = 0.3,
                                         .numbers = {soft},
                                         .flags = {{&HapticSettings::force_shading, true}},
                                         .choices = {Choice("free_side", FreeSide::kAbove),
                                                     Choice("method", DecompositionMethod::kBcc)}});
  EXPECT_EQ(seen.volumes, std::vector{state.volume->revision()});
  EXPECT_EQ(seen.isovalues, std::vector{0.3});
  EXPECT_EQ(seen.settings[0].stiffness_n_per_mm, 0.2);
  EXPECT_TRUE(seen.settings[0].force_shading);
  EXPECT_EQ(seen.settings[0].free_side, FreeSide::kAbove);
  EXPECT_EQ(session().settings().settings.haptics.method, DecompositionMethod::kBcc);
  EXPECT_EQ(session().settings().settings_revision, before.settings_revision + 1);
}

TEST_F(SessionTest, ACancelledLoadKeepsTheVolume) {
  const VolumeState before = session().volume();
  int asked = 0;
  EXPECT_EQ(Refusal([&] {
              session().Load({.source = "builtin:bumps:32"}, kQuiet, [&] { return ++asked > 33; });
            }),
            ErrorKind::kCancelled);
  EXPECT_EQ(session().volume().volume, before.volume);
}

TEST_F(SessionTest, ALoadChoosesItsIsovalueAnewAndIsSeenAtOneTick) {
  session().Update({.normalized_isovalue = 0.3});
  const VolumeState state = session().Load({.source = "builtin:gyroid:32"}, kQuiet, kNever);
  EXPECT_EQ(state.volume->revision(), 2u);
  EXPECT_EQ(state.isovalue, state.values->suggested.front().isovalue);
  EXPECT_NEAR(session().settings().settings.normalized_isovalue, 0.5, 1e-12);
  EXPECT_GT(session().WaitForServo(state.scene_revision).tick, 0u);
}

// As after a crash with a level set: its free side is not that of the densities that follow.
TEST_F(SessionTest, AFirstLevelSetKeepsItsSideForItself) {
  SceneInbox inbox;
  Session session(device(), inbox, pump(), VolumeLoader{});
  RenderSettings left;
  left.haptics.free_side = FreeSide::kAbove;
  session.SetInitial(left);
  VolumeMetadata metadata;
  metadata.size = Vec3i::Constant(16);
  metadata.value_min = -7.0;
  metadata.value_max = 7.0;
  metadata.is_level_set = true;
  session.PublishVolume({.source = "made"}, metadata,
                        testing::MakeBricks(metadata.size, [](int i, int, int) {
                          return static_cast<float>(i) - 7.0f;
                        }));
  EXPECT_EQ(session.settings().settings.haptics.free_side, FreeSide::kAbove);
  session.Load({.source = "builtin:sphere:16"}, kQuiet, kNever);
  EXPECT_EQ(session.settings().settings.haptics.free_side, FreeSide::kBelow);
}

// What listeners get before the first volume, and what clients are told.
TEST_F(SessionTest, BeforeTheFirstVolumeOnlySettingsChange) {
  SceneInbox inbox;
  Session session(device(), inbox, pump(), VolumeLoader{});
  EXPECT_TRUE(inbox.Acquire()->forces_off);
  EXPECT_EQ(Refusal([&] { session.Update({.isovalue = 0.5}); }), ErrorKind::kLoading);
  session.first_load().Tell("loading head.nrrd, 40 %");
  EXPECT_EQ(Refusal([&] { session.first_load().Require(); }), ErrorKind::kLoading);
  session.first_load().Fail(Error(ErrorKind::kNotFound, "gone"));
  EXPECT_EQ(Refusal([&] { session.first_load().Require(); }), ErrorKind::kNotFound);
  session.Load({.source = "builtin:sphere:16"}, kQuiet, kNever);
  session.first_load().Require();
  EXPECT_FALSE(inbox.Acquire()->forces_off);
}

// Collects samples on the pump thread and checks that none mixes revisions.
class Checker : public SampleSink {
 public:
  void OnSample(const TickSample& sample) override {
    ++samples_;
    contacts_ += sample.contact;
    // The test sets the isovalue to 0.3 + revision mod 5 / 10.
    const double expected = 0.3 + static_cast<double>(sample.settings_revision % 5) / 10.0;
    // Under a stylus that touches, the isovalue moves there.
    const double left = std::abs(sample.isovalue - expected);
    const bool nearer = left == 0.0 || left < std::abs(last_isovalue_ - expected);
    if (sample.settings_revision > 1) mixed_ += !nearer;
    last_isovalue_ = sample.isovalue;
    above_ += sample.density > sample.isovalue && sample.mode != ProxyMode::kEjecting &&
              sample.mode != ProxyMode::kInside;
    went_back_ += sample.settings_revision < last_revision_;
    last_revision_ = sample.settings_revision;
  }
  std::atomic<int> contacts_ = 0;
  int samples_ = 0, mixed_ = 0, above_ = 0, went_back_ = 0;
  std::uint64_t last_revision_ = 0;
  double last_isovalue_ = 0.0;
};

TEST_F(SessionTest, NoTickMixesRevisionsUnderAStreamOfUpdates) {
  const auto checker = std::make_shared<Checker>();
  pump().Subscribe(checker);
  for (int n = 0; n < 1000 || (checker->contacts_ <= 50 && n < 30'000); ++n) {
    const std::uint64_t next = session().settings().settings_revision + 1;
    session().Update({.isovalue = 0.3 + static_cast<double>(next % 5) / 10.0});
  }
  Stop();
  EXPECT_GT(checker->samples_, 1000);
  EXPECT_GT(checker->contacts_, 50);
  EXPECT_EQ(checker->mixed_, 0);
  EXPECT_EQ(checker->above_, 0);
  EXPECT_EQ(checker->went_back_, 0);
}

// Samples that nobody carries say nothing about the loop.
TEST_F(SessionTest, AnUpdateIsAppliedWhileThePumpStandsStill) {
  const SettingsApplied before = session().Update({.isovalue = 0.4});
  pump().Stop();
  SettingsApplied last = before;
  for (const double isovalue : {0.5, 0.6, 0.7}) {
    const SettingsApplied applied = session().Update({.isovalue = isovalue});
    EXPECT_EQ(applied.state.settings.isovalue, isovalue);
    EXPECT_GT(applied.applied.tick, last.applied.tick);
    EXPECT_GT(applied.applied.time_ns, last.applied.time_ns);
    last = applied;
  }
}

// Whether it stopped just now or long ago.
TEST_F(SessionTest, AnUpdateWithoutAServoChangesNothing) {
  const SettingsState before = session().Update({.isovalue = 0.4}).state;
  servo().Stop();
  const SettingsUpdate update{.isovalue = 0.5,
                              .numbers = {{&HapticSettings::damping_n_s_per_m, 1.0}},
                              .choices = {Choice("method", DecompositionMethod::kBcc)}};
  for (int n = 0; n < 2; ++n) {
    EXPECT_EQ(Refusal([&] { session().Update(update); }), ErrorKind::kUnavailable);
    const RenderSettings after = session().settings().settings;
    EXPECT_EQ(after.isovalue, before.settings.isovalue);
    EXPECT_EQ(after.normalized_isovalue, before.settings.normalized_isovalue);
    EXPECT_EQ(after.haptics.method, before.settings.haptics.method);
    EXPECT_EQ(after.haptics.damping_n_s_per_m, before.settings.haptics.damping_n_s_per_m);
  }
}

class Scenes final : public SceneListener {
 public:
  explicit Scenes(Session& session) : listening_(session, *this) {}
  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override {
    if (!changes.empty()) edited[scene.scene_revision] = scene.volume->revision();
    ++count;
  }

  std::map<std::uint64_t, std::uint64_t> edited;  // volume revision, by scene revision
  int count = 0;

 private:
  const Listening listening_;
};

TEST_F(SessionTest, AListenerThatIsGoneHearsNothing) {
  auto first = std::make_unique<Scenes>(session());
  const Scenes second(session());
  session().SetForcesOff(true);
  EXPECT_EQ(first->count, 1);
  first.reset();
  session().SetForcesOff(false);
  EXPECT_EQ(second.count, 2);
}

// Not that of a scene that somebody else published a moment later.
TEST_F(SessionTest, AnEditNamesItsOwnScene) {
  VolumeEditor editor(session());
  const Scenes scenes(session());
  std::atomic<bool> stop = false;
  std::thread others([&] {
    while (!stop) session().SetForcesOff(false);
  });
  for (int n = 0; n < 300; ++n) {
    const EditOutcome outcome = editor.Edit(
        {.shape = BoxShape{Vec3(4, 4, 4), Vec3(27, 27, 27)}, .value = n % 2 == 0 ? 0.25 : 0.75});
    const auto scene = scenes.edited.find(outcome.scene_revision);
    ASSERT_NE(scene, scenes.edited.end()) << n;
    ASSERT_EQ(scene->second, outcome.volume_revision);
  }
  stop = true;
  others.join();
}

TickSample Sample(std::uint64_t tick, ForceState state, ForceReason reason = ForceReason::kNone) {
  TickSample sample;
  sample.tick = tick;
  sample.force_state = state;
  sample.force_reason = reason;
  sample.force_limit_n = 0.5 + static_cast<double>(tick);
  return sample;
}

TEST(ForceWatch, KnowsNothingBeforeTheFirstTick) {
  const LastTickBoard board;
  const ForceWatch watch(board);
  EXPECT_FALSE(watch.newest());
  EXPECT_FALSE(watch.WaitForTick(0, milliseconds(1)));
}

TEST(ForceWatch, TellsTheNewestTickAndSinceWhenItIsSo) {
  LastTickBoard board;
  const ForceWatch watch(board);
  board.Tell(Sample(7, ForceState::kOn));
  board.Tell(Sample(9, ForceState::kOn));
  ASSERT_TRUE(watch.newest());
  EXPECT_EQ(watch.newest()->tick, 9u);
  EXPECT_EQ(watch.newest()->since_tick, 7u);
  EXPECT_EQ(watch.newest()->forces.limit_n, 9.5);
  board.Tell(Sample(10, ForceState::kStopped, ForceReason::kStopButton));
  EXPECT_EQ(watch.newest()->since_tick, 10u);
  // Another reason is another story.
  board.Tell(Sample(12, ForceState::kStopped, ForceReason::kStopCall));
  EXPECT_EQ(watch.newest()->since_tick, 12u);
  EXPECT_EQ(watch.newest()->forces.state, ForceState::kStopped);
  EXPECT_EQ(watch.newest()->forces.reason, ForceReason::kStopCall);
}

TEST(ForceWatch, AnOldTickIsNoWait) {
  LastTickBoard board;
  const ForceWatch watch(board);
  board.Tell(Sample(100, ForceState::kOff, ForceReason::kOperator));
  for (const std::uint64_t tick : {0u, 99u, 100u}) {
    ASSERT_TRUE(watch.WaitForTick(tick, milliseconds(0)));
    EXPECT_EQ(watch.WaitForTick(tick, milliseconds(0))->tick, 100u);
  }
  EXPECT_FALSE(watch.WaitForTick(101, milliseconds(0)));
  EXPECT_FALSE(watch.WaitForTick(101, milliseconds(5)));
}

TEST(ForceWatch, ManyWaitEachForItsTick) {
  LastTickBoard board;
  const ForceWatch watch(board);
  constexpr std::uint64_t kTicks = 2000;
  std::atomic<int> wrong{0};
  std::vector<std::thread> waiters;
  for (std::uint64_t step = 1; step <= 8; ++step) {
    waiters.emplace_back([&, step] {
      for (std::uint64_t tick = step; tick < kTicks; tick += step * 10) {
        const auto seen = watch.WaitForTick(tick, std::chrono::seconds(60));
        // Never an older one, and its parts belong together.
        wrong += !seen || seen->tick < tick || seen->forces.limit_n != 0.5 + seen->tick ||
                 seen->since_tick > seen->tick ||
                 (seen->forces.state == ForceState::kOn) != (seen->tick / 50 % 2 == 0);
      }
    });
  }
  for (std::uint64_t tick = 0; tick < kTicks; ++tick) {
    board.Tell(Sample(tick, tick / 50 % 2 == 0 ? ForceState::kOn : ForceState::kHeld));
    if (tick % 100 == 0) std::this_thread::sleep_for(milliseconds(1));
  }
  for (std::thread& waiter : waiters) waiter.join();
  EXPECT_EQ(wrong, 0);
}

// Samples that are late, or lost, tell of no scene: here, the pump delivers none.
TEST(Pump, NamesTheFirstTickOfEachSceneWithoutSamples) {
  const auto outbox = std::make_unique<TickOutbox>();
  SceneInbox inbox;
  Pump pump(*outbox, inbox);
  for (std::uint64_t tick = 0; tick < 10; ++tick) {
    TickSample sample = Sample(tick, ForceState::kOn);
    sample.time_ns = 1000 + static_cast<std::int64_t>(tick);
    sample.scene_revision = tick < 3 ? 1 : tick < 7 ? 2 : 5;
    outbox->last.Tell(sample);
  }
  const std::vector<std::uint64_t> first_ticks = {0, 3, 7, 7, 7};
  for (std::uint64_t revision = 1; revision <= 5; ++revision) {
    const auto applied = pump.WaitForScene(revision, std::chrono::seconds(60));
    ASSERT_TRUE(applied);
    EXPECT_EQ(applied->tick, first_ticks[revision - 1]);
    EXPECT_EQ(applied->time_ns, 1000 + static_cast<std::int64_t>(applied->tick));
  }
  EXPECT_FALSE(pump.WaitForScene(6, milliseconds(1)));
}

// One who makes a message of each sample delays neither a recording nor one who comes.
TEST(Pump, NoSinkHoldsUpASubscriberAndLiveOnesComeFirst) {
  struct Sink final : SampleSink {
    explicit Sink(std::function<void()> called) : called_(std::move(called)) {}
    void OnSample(const TickSample&) override { called_(); }
    const std::function<void()> called_;
  };
  const auto outbox = std::make_unique<TickOutbox>();
  SceneInbox inbox;
  Pump pump(*outbox, inbox);
  std::promise<void> called, subscribed;
  std::atomic<int> recorded{0}, recorded_before{-1}, later{0};
  const auto viewer = std::make_shared<Sink>([&] {
    if (recorded_before >= 0) return;
    recorded_before = recorded.load();
    called.set_value();
    subscribed.get_future().wait();
  });
  const auto recorder = std::make_shared<Sink>([&] { ++recorded; });
  const auto newcomer = std::make_shared<Sink>([&] { ++later; });
  pump.Subscribe(viewer, Pump::Feed::kShown);
  pump.Subscribe(recorder);
  pump.Start();
  outbox->TryPush(Sample(0, ForceState::kOn));
  called.get_future().wait();
  pump.Subscribe(newcomer);
  subscribed.set_value();
  outbox->TryPush(Sample(1, ForceState::kOn));
  EXPECT_TRUE(test::Eventually([&] { return later == 1; }));
  EXPECT_EQ(recorded_before, 1);
}

TEST(LastTick, KnowsItsScene) {
  LastTickBoard board;
  EXPECT_FALSE(board.newest());
  for (std::uint64_t tick = 0; tick < 10; ++tick) {
    TickSample sample = Sample(tick, ForceState::kOn);
    sample.scene_revision = tick < 3 ? 1 : tick < 7 ? 2 : 5;
    board.Tell(sample);
    ASSERT_TRUE(board.newest());
    EXPECT_EQ(board.newest()->tick, tick);
    EXPECT_EQ(board.newest()->scene_revision, sample.scene_revision);
  }
}

}  // namespace
}  // namespace palpate
