// Recordings and replays of a running session: servo, pump and session as in the
// daemon, without gRPC.
#include "server/recording/recording_control.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/client_paths/path_policy.h"
#include "server/recording/replayer.h"
#include "server/simulated_hand/explore_script.h"
#include "tests/support/recording_control_rig.h"
#include "tests/support/refusal.h"
#include "tests/support/running_session.h"
#include "tests/support/scene_rig.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using test::Eventually;
using testing::Carve;
using testing::kNever;
using testing::Refusal;

using testing::Collector;
using testing::kUnwatched;
using RecordingControlTest = testing::RecordingControlRig;

TEST_F(RecordingControlTest, OneAtATimeAndOnlyWhereAllowed) {
  EXPECT_FALSE(control_.status().running);
  EXPECT_EQ(Refusal([&] { control_.Stop(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { control_.Mark("m"); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { control_.Start(File("forbidden"), false); }),
            ErrorKind::kPermissionDenied);
  EXPECT_EQ(Refusal([&] { control_.Start(File("no/folder"), false); }), ErrorKind::kNotFound);
  EXPECT_FALSE(control_.status().running);
  control_.Start(File("a"), false);
  EXPECT_EQ(Refusal([&] { control_.Start(File("b"), false); }), ErrorKind::kConflict);
  EXPECT_FALSE(std::filesystem::exists(File("b")));
  EXPECT_EQ(Refusal([&] { control_.Replay(File("a"), {}, kUnwatched, kNever); }),
            ErrorKind::kConflict);
  EXPECT_GT(control_.Mark(std::string(4096, 'x')), 0);
  control_.Stop();
  EXPECT_EQ(Refusal([&] { control_.Stop(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { control_.Start(File("a"), false); }), ErrorKind::kConflict);
  control_.Start(File("a"), true);
  AwaitTicks(100);
  control_.End();
  control_.End();
  EXPECT_EQ(ComputeAgain("a", volume()).differing, 0u);
}

TEST_F(RecordingControlTest, BadReplaysAreRefusedAndChangeNothing) {
  RecordEdits("a", false);  // and keeps the edits
  const VolumeState before = session().volume();
  const auto refusal = [&](const std::string& name, const ViewerReplayOptions& options = {}) {
    return Refusal([&] { control_.Replay(File(name), options, kUnwatched, kNever); });
  };
  EXPECT_EQ(refusal("absent"), ErrorKind::kNotFound);
  EXPECT_EQ(refusal("forbidden"), ErrorKind::kPermissionDenied);
  EXPECT_EQ(refusal("."), ErrorKind::kInvalidArgument);
  for (const double bad : {-1.0, 0.0, 100.1, std::nan("")}) {
    EXPECT_EQ(refusal("a", {.speed = bad}), ErrorKind::kInvalidArgument);
  }
  std::ofstream(File("text")) << "no recording";
  const RecordedEdit edit{.bricks = {{0, Leaf::Constant(LeafType::kFloat, 0.0f)}}};
  for (const auto& [name, edits] : {std::pair("empty", 0), std::pair("huge", 100)}) {
    RecordingWriter writer(CreateRecordingFile(File(name), false), "test");
    for (int n = 0; n < edits; ++n) writer.Append(edit);
    writer.AppendEnd();
  }
  for (const char* name : {"text", "empty", "huge"}) {
    EXPECT_EQ(refusal(name), ErrorKind::kInvalidArgument) << name;
  }
  {
    const auto loading = session().BeginLoad();
    EXPECT_EQ(refusal("a"), ErrorKind::kConflict);
  }
  // Voxels have changed since: neither the one that was loaded nor that of the start.
  EXPECT_EQ(refusal("a"), ErrorKind::kConflict);
  EXPECT_EQ(volume(), before.volume);
  EXPECT_EQ(session().volume().scene_revision, before.scene_revision);
  Load("builtin:gyroid:40");
  EXPECT_EQ(refusal("a"), ErrorKind::kConflict);
  Load("builtin:gyroid:32");
  EXPECT_EQ(refusal("a", {.speed = 50.0}), std::nullopt);
  std::uint64_t total = 0;
  control_.Replay(
      File("a"), {.speed = 50.0}, [&](const ReplayReport& now) { total = now.total_ticks; },
      kNever);
  EXPECT_EQ(refusal("a", {.first_tick = total}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal("a", {.first_tick = total - 1}), std::nullopt);
  EXPECT_EQ(session().volume().volume, volume());
}

// The first scene and the samples of `file` in `to`, with so many texts before the last samples.
void WriteWithTexts(const std::string& file, const std::string& to, int count) {
  RecordingReader reader(file);
  RecordingWriter writer(CreateRecordingFile(to, false), "test");
  bool has_scene = false;
  std::vector<RecordedSamples> after;
  while (std::optional<RecordedItem> item = reader.Next()) {
    const auto* scene = std::get_if<RecordedScene>(&*item);
    if (scene && !std::exchange(has_scene, true)) writer.Append(*scene);
    if (auto* samples = std::get_if<RecordedSamples>(&*item)) after.push_back(*samples);
  }
  ASSERT_GE(after.size(), 2u);
  const RecordedSamples last = std::move(after.back());
  after.pop_back();
  for (const RecordedSamples& samples : after) testing::Append(writer, samples);
  for (int n = 0; n < count; ++n) {
    writer.Append(RecordedEvent{.tick = *writer.next_tick(), .marker = std::string(4096, 'x')});
  }
  testing::Append(writer, last);
  writer.AppendEnd();
}

// More than are read ahead.
TEST_F(RecordingControlTest, AReplayPassesThousandsOfTextsBetweenTwoTicks) {
  RecordEdits("a");
  WriteWithTexts(File("a"), File("texts"), 3000);
  std::size_t texts = 0;
  std::uint64_t ticks = 0, total = 0;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(15);
  EXPECT_EQ(Refusal([&] {
              control_.Replay(
                  File("texts"), {.speed = 50.0},
                  [&](const ReplayReport& now) {
                    if (!now.state.marker.empty()) ++texts;
                    ticks = now.state.ticks;
                    total = now.total_ticks;
                  },
                  [&] { return std::chrono::steady_clock::now() > end; });
            }),
            std::nullopt);
  EXPECT_EQ(texts, 3000u);
  EXPECT_EQ(ticks, total);
}

// 200 MB of texts in a small file, between two ticks.
TEST_F(RecordingControlTest, AReplayReadsFewTextsAheadAndCanBeCancelledInTheMidst) {
  RecordEdits("a");
  WriteWithTexts(File("a"), File("texts"), 50'000);
  EXPECT_LT(std::filesystem::file_size(File("texts")), 20u << 20);
  const std::size_t before_bytes = mallinfo2().uordblks;
  std::size_t most_bytes = 0;
  int asked = 0;
  int looks = 0;
  bool plays = false;
  const auto cancelled = [&] {
    // Asked for each text of the whole recording first: the question costs more than a text.
    if (plays || ++looks % 1000 == 0) most_bytes = std::max(most_bytes, mallinfo2().uordblks);
    return plays && ++asked == 3000;
  };
  std::size_t markers = 0;
  EXPECT_EQ(Refusal([&] {
              control_.Replay(
                  File("texts"), {},
                  [&](const ReplayReport& now) {
                    plays = true;
                    markers += now.markers.size();
                  },
                  cancelled);
            }),
            ErrorKind::kCancelled);
  EXPECT_GT(markers, 200u);
  EXPECT_LT(markers, 260u);  // of 1 MiB
  EXPECT_LT(most_bytes, before_bytes + (32u << 20));
}

TEST_F(RecordingControlTest, OnlyRecordingsAreReplacedByRecordings) {
  const auto start = [&](const char* name) {
    return Refusal([&] {
      control_.Start(File(name), true);
      control_.Stop();
    });
  };
  for (const char* text : {"", "PAL", "my notes of ten years"}) {
    std::ofstream(File("notes")) << text;
    EXPECT_EQ(start("notes"), ErrorKind::kConflict) << text;
    std::ifstream notes(File("notes"));
    EXPECT_TRUE(std::string(std::istreambuf_iterator<char>(notes), {}) == text);
  }
  EXPECT_EQ(start("new"), std::nullopt);
  EXPECT_EQ(start("new"), std::nullopt);
}

TEST_F(RecordingControlTest, ViewersSeeEveryRecordedTickInPlaceOfTheLiveOnes) {
  const std::vector<TickSample> recorded = RecordEdits("a");
  const VolumeState before = session().volume();
  const auto viewer = std::make_shared<Collector>(), tool = std::make_shared<Collector>();
  pump().Subscribe(viewer, Pump::Feed::kShown);
  pump().Subscribe(tool);
  std::vector<std::string> markers;
  std::uint64_t ticks = 0;
  std::set<std::uint64_t> hashes;
  std::vector<RecordedMarker> timeline;
  control_.Replay(
      File("a"), {},
      [&](const ReplayReport& now) {
        ticks = now.state.ticks;
        hashes.insert(ShownHash().low);
        EXPECT_EQ(LiveHash(), HashVolume(*before.volume));
        if (!now.state.marker.empty()) markers.push_back(now.state.marker);
        timeline.insert(timeline.end(), now.markers.begin(), now.markers.end());
        EXPECT_EQ(now.total_ticks, recorded.size());
        EXPECT_EQ(Refusal([&] { control_.Start(File("b"), false); }), ErrorKind::kConflict);
      },
      kNever);
  EXPECT_EQ(ticks, recorded.size());
  EXPECT_EQ(markers.size(), 10u);
  ASSERT_EQ(timeline.size(), 10u);
  for (std::size_t n = 0; n < timeline.size(); ++n) EXPECT_EQ(timeline[n].text, markers[n]);
  EXPECT_GE(hashes.size(), 3u);
  EXPECT_TRUE(hashes.contains(recorded_hash_.low));
  EXPECT_EQ(LiveHash(), HashVolume(*before.volume));
  AwaitTicks(50);

  std::vector<TickSample> shown = viewer->Take(), live = tool->Take();
  // They were subscribed one after the other: a tick may have come between.
  const std::uint64_t first = std::max(shown.front().tick, live.front().tick);
  const std::uint64_t last = std::min(shown.back().tick, live.back().tick);
  for (auto* samples : {&shown, &live}) {
    std::erase_if(*samples, [&](const auto& s) { return s.tick < first || s.tick > last; });
  }
  ASSERT_EQ(shown.size(), live.size());
  const auto is_same = [](const TickSample& a, const TickSample& b) {
    return a.hip_mm == b.hip_mm && a.force_n == b.force_n && a.isovalue == b.isovalue &&
           a.update_ns == b.update_ns;
  };
  // Under the live tick: live until the first is due, then recorded ones in their order. Live ticks
  // that were missed pass some over.
  std::size_t next = 0;
  for (std::size_t n = 0; n < shown.size(); ++n) {
    ASSERT_EQ(shown[n].tick, live[n].tick);
    ASSERT_EQ(shown[n].scene_revision, live[n].scene_revision);
    ASSERT_EQ(shown[n].force_state, live[n].force_state);
    EXPECT_FALSE(live[n].replayed);
    ASSERT_EQ(shown[n].replayed, !is_same(shown[n], live[n]));
    if (!shown[n].replayed) continue;
    while (next < recorded.size() && !is_same(shown[n], recorded[next])) ++next;
    ASSERT_LT(next, recorded.size());
  }
  EXPECT_EQ(next + 1, recorded.size());
  // Live again.
  EXPECT_NE(shown.back().mode, ProxyMode::kSuspended);
  EXPECT_FALSE(shown.back().replayed);
  EXPECT_EQ(shown.back().hip_mm, live.back().hip_mm);
}

// The state of any tick is shown as if all before it had been played.
TEST_F(RecordingControlTest, AReplayBeginsAnywhere) {
  const std::vector<TickSample> recorded = RecordEdits("a");
  RecordingReader reader(File("a"));
  const std::vector<RecordedItem> items = testing::ReadAll(reader);
  std::mt19937_64 random(7);
  for (int n = 0; n < 12; ++n) {
    const std::uint64_t first = n == 0 ? recorded.size() - 1 : random() % recorded.size();
    const std::uint64_t tick = recorded[first].tick;
    VolumeHash expected;
    for (const RecordedItem& item : items) {
      const auto* const scene = std::get_if<RecordedScene>(&item);
      if (scene && scene->tick <= tick) expected = scene->volume_hash;
    }
    const auto viewer = std::make_shared<Collector>();
    pump().Subscribe(viewer, Pump::Feed::kShown);
    std::optional<VolumeHash> shown;
    std::vector<std::uint64_t> places;
    // So slow that nothing changes before the first look at the voxels.
    const auto watch = [&](const ReplayReport& now) {
      if (!shown) shown = ShownHash();
      places.push_back(now.state.ticks);
    };
    const auto cancelled = [&] { return !places.empty() && places.back() > first; };
    const auto kind = Refusal([&] {
      control_.Replay(File("a"), {.speed = 1e-6, .first_tick = first}, watch, cancelled);
    });
    // The last tick's replay has ended by then.
    if (n > 0) {
      EXPECT_EQ(kind, ErrorKind::kCancelled);
    }
    EXPECT_EQ(*shown, expected) << first;
    EXPECT_GE(places.front(), first);
    EXPECT_LE(places.back(), first + 1);
    const std::vector<TickSample> samples = viewer->Take();
    EXPECT_TRUE(std::any_of(samples.begin(), samples.end(), [&](const TickSample& sample) {
      return sample.hip_mm == recorded[first].hip_mm && sample.force_n == recorded[first].force_n &&
             sample.scp_h_mm == recorded[first].scp_h_mm &&
             sample.update_ns == recorded[first].update_ns;
    })) << first;
  }
}

// Behind lost ticks, too, the first tick is shown at once, however slow the replay is.
TEST_F(RecordingControlTest, AReplayBeginsBehindLostTicks) {
  RecordEdits("a");
  std::vector<TickSample> kept;
  std::vector<std::uint64_t> behind;  // places of the first ticks after lost ones
  {
    RecordingReader reader(File("a"));
    RecordingWriter writer(CreateRecordingFile(File("gaps"), false), "test");
    while (const std::optional<RecordedItem> item = reader.Next()) {
      if (const auto* scene = std::get_if<RecordedScene>(&*item)) writer.Append(*scene);
      if (const auto* edit = std::get_if<RecordedEdit>(&*item)) writer.Append(*edit);
      const auto* const samples = std::get_if<RecordedSamples>(&*item);
      for (std::size_t n = 0; samples && n < samples->size(); ++n) {
        const TickSample& sample = (*samples)[n];
        if (sample.tick % 60 < 20) continue;
        if (sample.tick % 60 == 20) behind.push_back(kept.size());
        testing::Append(writer, {sample});
        kept.push_back(sample);
      }
    }
    writer.AppendEnd();
  }
  ASSERT_GE(behind.size(), 3u);
  behind.insert(behind.begin(), 0);
  for (const std::uint64_t first : {behind[0], behind[1], behind[behind.size() / 2]}) {
    const auto viewer = std::make_shared<Collector>();
    pump().Subscribe(viewer, Pump::Feed::kShown);
    std::uint64_t place = 0;
    int reports = 0;
    Refusal([&] {
      control_.Replay(
          File("gaps"), {.speed = 1e-6, .first_tick = first},
          [&](const ReplayReport& now) {
            place = now.state.ticks;
            ++reports;
          },
          [&] { return place > first || reports > 300; });
    });
    EXPECT_EQ(place, first + 1);
    const std::vector<TickSample> samples = viewer->Take();
    EXPECT_TRUE(std::any_of(samples.begin(), samples.end(), [&](const TickSample& sample) {
      return sample.hip_mm == kept[first].hip_mm && sample.update_ns == kept[first].update_ns;
    })) << first;
  }
}

// The outline of the last file is known: a jump to another place does not read the whole file.
TEST_F(RecordingControlTest, TheOutlineOfAFileIsReadOnce) {
  RecordEdits("a");
  RecordEdits("b");
  const auto outline_of = [&](const std::string& name, int opened) {
    std::optional<ReplayReport> first;
    opened_ = 0;
    Refusal([&] {
      control_.Replay(
          File(name), {},
          [&](const ReplayReport& now) {
            if (!first) first = now;
          },
          [&] { return first.has_value(); });
    });
    EXPECT_EQ(opened_, opened);
    EXPECT_EQ(first->total_ticks, RecordedTicks(name));
    EXPECT_EQ(first->markers.size(), name == "a" || name == "b" ? 10u : 0u);
  };
  for (const int opened : {2, 1, 1}) outline_of("a", opened);
  for (const int opened : {2, 1}) outline_of("b", opened);
  outline_of("a", 2);
  for (const char* name : {"short", "short"}) {
    control_.Start(File(name), true);
    AwaitTicks(100);
    control_.Stop();
    outline_of(name, 2);
  }
}

TEST_F(RecordingControlTest, ACancelledReplayBringsBackWhatWas) {
  RecordEdits("a");
  const VolumeHash before = LiveHash();
  const AffineMap place = session().volume().X_DI;
  std::atomic<bool> changed{false};
  EXPECT_EQ(Refusal([&] {
              control_.Replay(
                  File("a"), {.speed = 0.5},
                  [&](const ReplayReport&) { changed = changed || ShownHash() != before; },
                  [&] { return changed.load(); });
            }),
            ErrorKind::kCancelled);
  EXPECT_TRUE(changed);
  EXPECT_EQ(LiveHash(), before);
  EXPECT_EQ(session().volume().X_DI.linear, place.linear);
  const auto tool = std::make_shared<Collector>();
  pump().Subscribe(tool, Pump::Feed::kShown);
  EXPECT_TRUE(Eventually([&] {
    const std::vector<TickSample> samples = tool->Take();
    return !samples.empty() && samples.back().mode != ProxyMode::kSuspended;
  }));
  control_.Start(File("b"), false);  // the way is free
  control_.Stop();
}

class RefusesScenes final : public SceneListener {
 public:
  explicit RefusesScenes(Session& session) : listening_(session, *this) {}
  void OnScene(const Scene&, std::span<const BrickChange>) override {
    if (refuses) throw Error(ErrorKind::kTooLarge, "no memory");
  }
  std::atomic<bool> refuses{false};

 private:
  const Listening listening_;
};

// Until another replay has ended better.
TEST_F(RecordingControlTest, WithoutTheLiveVolumeForcesStayOffAndWhyIsSaid) {
  RecordEdits("a");
  RefusesScenes listener(session());
  const VolumeHash before = LiveHash();
  const auto viewer = std::make_shared<Collector>();
  pump().Subscribe(viewer, Pump::Feed::kShown);
  try {
    control_.Replay(File("a"), {.speed = 2.0}, kUnwatched, [&] {
      listener.refuses = ShownHash() != before;
      return listener.refuses.load();
    });
    FAIL() << "it ended";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInternal);
    EXPECT_NE(std::string(error.what()).find("no memory"), std::string::npos) << error.what();
  }
  listener.refuses = false;
  EXPECT_TRUE(session().forces_off());
  EXPECT_TRUE(session().shown().volume().replayed);
  viewer->Take();
  AwaitTicks(20);
  EXPECT_TRUE(viewer->Take().back().replayed);
  EXPECT_EQ(LiveHash(), before);
  control_.Replay(File("a"), {.speed = 50.0}, kUnwatched, kNever);
  EXPECT_FALSE(session().forces_off());
  EXPECT_FALSE(session().shown().volume().replayed);
  EXPECT_EQ(LiveHash(), before);
}

// Everybody can ask who replays what, from the first tick to the last, and nobody else.
TEST_F(RecordingControlTest, SaysWhoReplaysWhat) {
  const std::vector<TickSample> recorded = RecordEdits("a");
  EXPECT_FALSE(control_.status().replay);
  std::uint64_t reports = 0;
  control_.Replay(
      File("a"), {.speed = 4.0, .by = "token ada"},
      [&](const ReplayReport& now) {
        const std::optional<RunningReplay> replay = control_.status().replay;
        ASSERT_TRUE(replay);
        EXPECT_EQ(replay->by, "token ada");
        EXPECT_EQ(replay->path, File("a"));
        EXPECT_EQ(replay->ticks, now.state.ticks);
        EXPECT_EQ(replay->total_ticks, recorded.size());
        EXPECT_EQ(replay->speed, 4.0);
        ++reports;
      },
      kNever);
  EXPECT_GT(reports, 0u);
  EXPECT_FALSE(control_.status().replay);
  Refusal([&] { control_.Replay(File("absent"), {}, kUnwatched, kNever); });
  EXPECT_FALSE(control_.status().replay);
}

// Each pose names the settings of its recorded scene, which viewers are shown with it, while the
// session stays as it is.
TEST_F(RecordingControlTest, TheScenesAreShownWithTheirTicks) {
  std::mt19937_64 random(1);
  const BrickDirectory loaded = volume()->bricks();
  control_.Start(File("a"), false);
  for (int n = 0; n < 8; ++n) {
    session().Update({.normalized_isovalue = 0.3 + 0.05 * n,
                      .numbers = {{&HapticSettings::stiffness_n_per_mm, 0.1 + 0.02 * n},
                                  {&HapticSettings::tool_radius_mm, n % 3 == 1 ? 2.0 : 0.0}}});
    if (n % 2 == 1) {
      session().Move([&](const VolumeState& state) {
        VolumePlace moved = state.registration;
        moved.X_DW.translation += Vec3(0.5 * n, 0.0, 0.0);
        return moved;
      });
    }
    if (n % 3 == 2) Edit(random);
    AwaitTicks(60);
  }
  control_.Stop();
  session().store().Edit([&](const auto& present) { return present->bricks().ChangesTo(loaded); });
  session().Update(
      {.normalized_isovalue = 0.9, .numbers = {{&HapticSettings::stiffness_n_per_mm, 0.4}}});
  const SettingsState live = session().settings();
  const VolumeState before = session().volume();

  std::map<std::uint64_t, RecordedScene> scenes;  // by the first tick
  std::vector<TickSample> recorded;
  RecordingReader reader(File("a"));
  for (const RecordedItem& item : testing::ReadAll(reader)) {
    if (const auto* scene = std::get_if<RecordedScene>(&item)) scenes[scene->tick] = *scene;
    if (const auto* samples = std::get_if<RecordedSamples>(&item)) {
      recorded.insert(recorded.end(), samples->begin(), samples->end());
    }
  }
  ASSERT_GT(scenes.size(), 12u);
  for (int n = 0; n < 50; ++n) {
    const std::uint64_t first = random() % (recorded.size() - 1);
    const RecordedScene& wanted = std::prev(scenes.upper_bound(recorded[first].tick))->second;
    const auto viewer = std::make_shared<Collector>();
    pump().Subscribe(viewer, Pump::Feed::kShown);
    std::uint64_t place = 0;
    bool is_seen = false;
    const auto watch = [&](const ReplayReport& now) {
      place = now.state.ticks;
      if (place != first + 1 || std::exchange(is_seen, true)) return;
      const SettingsState shown = session().shown().settings();
      const VolumeState volume = session().shown().volume();
      EXPECT_TRUE(shown.replayed && volume.replayed);
      EXPECT_EQ(shown.settings.isovalue, wanted.isovalue);
      EXPECT_EQ(shown.settings.haptics.stiffness_n_per_mm, wanted.settings.stiffness_n_per_mm);
      EXPECT_EQ(shown.settings.haptics.tool_radius_mm, wanted.settings.tool_radius_mm);
      const double felt_mm = session().shown().ball().felt_radius_mm;
      EXPECT_NEAR(felt_mm, recorded[first].tool_radius_mm, 1e-9);
      EXPECT_EQ(volume.X_DI, wanted.X_DI);
      EXPECT_EQ(volume.isovalue, wanted.isovalue);
      EXPECT_EQ(HashVolume(*volume.volume), wanted.volume_hash);
      const std::vector<TickSample> samples = viewer->Take();
      ASSERT_FALSE(samples.empty());
      EXPECT_EQ(samples.back().settings_revision, shown.settings_revision);
      EXPECT_EQ(samples.back().volume_revision, volume.volume->revision());
      EXPECT_GT(shown.settings_revision, live.settings_revision);
    };
    Refusal([&] {
      control_.Replay(File("a"), {.speed = 1e-6, .first_tick = first}, watch,
                      [&] { return is_seen; });
    });
    EXPECT_TRUE(is_seen) << first;
    // What is live has not changed, but viewers have to be told anew.
    const VolumeState after = session().volume();
    EXPECT_EQ(session().settings().settings.isovalue, live.settings.isovalue);
    EXPECT_GT(session().settings().settings_revision, live.settings_revision);
    EXPECT_FALSE(session().shown().settings().replayed);
    EXPECT_EQ(after.X_DI, before.X_DI);
    EXPECT_EQ(after.unsaved_edits, before.unsaved_edits);
    EXPECT_EQ(HashVolume(*after.volume), HashVolume(*before.volume));
    EXPECT_EQ(after.volume->metadata().series_position_frames, std::nullopt);
  }
}

// Another volume is loaded while recording: the replay ends there, and the rest is shown with it.
TEST_F(RecordingControlTest, ALoadWhileRecording) {
  control_.Start(File("a"), false);
  AwaitTicks(200);
  Load("builtin:bumps:32");
  AwaitTicks(200);
  const RecordingStatus stopped = control_.Stop();
  std::uint64_t ticks = 0;
  const auto replay = [&](std::uint64_t first_tick) {
    return Refusal([&] {
      control_.Replay(
          File("a"), {.speed = 10.0, .first_tick = first_tick},
          [&](const ReplayReport& now) { ticks = now.state.ticks; }, kNever);
    });
  };
  EXPECT_EQ(replay(0), ErrorKind::kConflict);
  EXPECT_EQ(replay(stopped.counts.ticks - 100), std::nullopt);
  EXPECT_EQ(ticks, stopped.counts.ticks);
  Load("builtin:gyroid:32");
  const VolumeHash before = LiveHash();
  EXPECT_EQ(replay(0), ErrorKind::kConflict);
  EXPECT_LT(ticks, stopped.counts.ticks - 150);
  EXPECT_FALSE(session().forces_off());
  EXPECT_EQ(LiveHash(), before);
}

}  // namespace
}  // namespace palpate
