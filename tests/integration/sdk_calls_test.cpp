// Every call of the client library against a real palpated, as a program uses it.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/sdk/calls.h"
#include "client/sdk/nrrd_file.h"
#include "client/sdk/words.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using testing::Refusal;

class SdkCalls : public ::testing::Test {
 protected:
  SdkCalls() {
    daemon_.Start();
    palpated_.emplace(server());
    palpated_->WaitUntilReached(60s);
  }

  Server server() const { return {.address = {.socket_path = daemon_.socket()}}; }
  std::string File(const std::string& name) const { return daemon_.folder() / name; }

  test::RestartedDaemon daemon_;
  std::optional<Calls> palpated_;
};

TEST_F(SdkCalls, VolumesAreLoadedSavedSentAndFetched) {
  Calls& p = *palpated_;
  std::vector<Progress> told;
  const auto keep = [&](const Progress& now) {
    told.push_back(now);
    return true;
  };
  const LoadResult loaded = p.LoadVolume("builtin:sphere:40", {.normalized_isovalue = 0.4}, keep);
  EXPECT_EQ(loaded.volume.source, "builtin:sphere:40");
  EXPECT_EQ(loaded.volume.size, Vec3i(40, 40, 40));
  EXPECT_EQ(p.GetVolume().volume_revision, loaded.volume.volume_revision);
  EXPECT_DOUBLE_EQ(p.GetSettings().normalized_isovalue, 0.4);
  ASSERT_FALSE(told.empty());
  for (std::size_t n = 1; n < told.size(); ++n) EXPECT_GE(told[n].fraction, told[n - 1].fraction);

  const EditResult edited = p.Apply({.shape = Box{Vec3(0, 0, 0), Vec3(7, 7, 7)},
                                     .frame = EditFrame::kIndex,
                                     .operation = EditOperation::kSet,
                                     .value = loaded.volume.value_max});
  EXPECT_EQ(edited.changed_voxels, 512u);
  const SaveResult saved = p.SaveVolume(File("edited.nrrd"));
  EXPECT_EQ(saved.volume_revision, edited.volume_revision);
  EXPECT_EQ(saved.size_bytes, std::filesystem::file_size(File("edited.nrrd")));
  EXPECT_EQ(Refusal([&] { p.SaveVolume(File("edited.nrrd")); }), ErrorKind::kConflict);
  EXPECT_EQ(p.SaveVolume(File("edited.nrrd"), true).size_bytes, saved.size_bytes);

  const DownloadResult copy = p.DownloadVolume();
  EXPECT_EQ(copy.volume.resume()->volume_revision, edited.volume_revision);
  EXPECT_FLOAT_EQ(copy.volume.bricks().Value(7, 7, 7), static_cast<float>(loaded.volume.value_max));
  SaveAsNrrd(copy.volume, File("copy.nrrd"));

  // What was fetched goes up again, as it was.
  told.clear();
  const LoadResult sent = p.UploadVolume(File("copy.nrrd"), {}, keep);
  EXPECT_EQ(sent.volume.source, "upload:copy.nrrd");
  EXPECT_EQ(sent.volume.patient_axes, "");  // as the built-in shape's
  EXPECT_TRUE(std::any_of(told.begin(), told.end(),
                          [](const Progress& now) { return now.stage == "sending"; }));
  const DownloadResult again = p.DownloadVolume();
  for (int n = 0; n < 40; ++n) {
    EXPECT_EQ(again.volume.bricks().Value(n, 39 - n, n / 2),
              copy.volume.bricks().Value(n, 39 - n, n / 2));
  }
}

TEST_F(SdkCalls, WhatIsCancelledChangesNothing) {
  Calls& p = *palpated_;
  const VolumeInfo before = p.GetVolume();
  const auto cancel_at = [](double fraction) {
    return [fraction](const Progress& now) { return now.fraction < fraction; };
  };
  EXPECT_EQ(Refusal([&] { p.LoadVolume("builtin:gyroid:200", {}, cancel_at(0.0)); }),
            ErrorKind::kCancelled);
  SaveAsNrrd(p.DownloadVolume().volume, File("a.nrrd"));
  EXPECT_EQ(Refusal([&] { p.UploadVolume(File("a.nrrd"), {}, cancel_at(0.1)); }),
            ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { p.UploadVolume(File("a.nrrd"), {}, [](auto&) { return false; }); }),
            ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { p.DownloadVolume([](auto&) { return false; }); }), ErrorKind::kCancelled);
  // What a callback throws, comes out. The load that was cancelled may take a moment to end.
  const auto load = [&] {
    try {
      p.LoadVolume("builtin:gyroid:200", {},
                   [](const Progress&) -> bool { throw std::out_of_range("no"); });
    } catch (const std::out_of_range&) {
      return true;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kConflict) << error.what();
    }
    return false;
  };
  EXPECT_TRUE(test::Eventually(load));
  EXPECT_EQ(p.GetVolume().volume_revision, before.volume_revision);
}

TEST_F(SdkCalls, ErrorsHaveKinds) {
  Calls& p = *palpated_;
  const VolumeInfo before = p.GetVolume();
  Calls nobody(Server{.address = {.socket_path = File("nobody.sock")}});
  using Call = std::function<void()>;
  const std::vector<std::pair<ErrorKind, std::vector<Call>>> refused = {
      {ErrorKind::kInvalidArgument,
       {[&] { p.LoadVolume("builtin:cheese"); },
        [&] { p.LoadVolume("builtin:sphere", {.isovalue = 1.0, .normalized_isovalue = 0.5}); },
        [&] { p.UploadVolume(daemon_.folder()); }, [&] { p.Set({.stiffness_n_per_mm = 99.0}); },
        [&] { p.Set({}); }, [&] { p.Place({.scale_by = -1.0}); }, [&] { p.CalibrateDevice(); },
        [&] { p.EnableForces("falcon"); }, [&] { p.StartRecording("relative"); }}},
      {ErrorKind::kConflict,
       {[&] { p.Set({.isovalue = 0.5, .expected_revision = 999999}); }, [&] { p.Undo(); },
        [&] { p.GetSeries(); }, [&] { p.StopRecording(); }}},
      {ErrorKind::kNotFound,
       {[&] { p.LoadVolume(File("absent.nrrd")); }, [&] { p.UploadVolume(File("absent.nrrd")); }}},
      {ErrorKind::kPermissionDenied, {[&] { p.SaveVolume("/nowhere/a.nrrd"); }}},
      {ErrorKind::kUnavailable,
       {[&] { nobody.WaitUntilReached(1s); }, [&] { nobody.GetVolume(); }}}};
  for (const auto& [kind, calls] : refused) {
    for (std::size_t n = 0; n < calls.size(); ++n) {
      EXPECT_EQ(Refusal(calls[n]), kind) << n;
    }
  }
  EXPECT_EQ(p.GetVolume().volume_revision, before.volume_revision);
}

TEST_F(SdkCalls, TheVolumeIsPlacedAndFelt) {
  Calls& p = *palpated_;
  const PlacementNow now = p.GetPlacement();
  const Placement& before = now.registration;
  const PlacementResult moved = p.Place({.translate_mm = Vec3(3, -2, 1), .scale_by = 2.0});
  EXPECT_LT((moved.registration.center_mm - before.center_mm - Vec3(3, -2, 1)).norm(), 1e-9);
  EXPECT_NEAR(moved.registration.device_mm_per_volume_mm, 2.0 * before.device_mm_per_volume_mm,
              1e-9);
  EXPECT_GT(moved.settings_revision, now.settings_revision);
  EXPECT_EQ(Refusal([&] { p.Place({.reset = true, .expected_revision = now.settings_revision}); }),
            ErrorKind::kConflict);
  PoseReader reader = p.ReadPoses(500.0, 5);
  std::optional<PoseBatch> batch;
  ASSERT_TRUE(test::Eventually([&] { return (batch = reader.Next(50ms)).has_value(); }));
  EXPECT_EQ(batch->poses.size(), 5u);
  EXPECT_GE(batch->poses.front().settings_revision, moved.settings_revision);
}

TEST_F(SdkCalls, ASeriesPlaysAndARecordingOfItIsReplayed) {
  Calls& p = *palpated_;
  for (int n = 0; n < 3; ++n) {
    p.LoadVolume("builtin:sphere:" + std::to_string(24));
    p.Apply({.shape = Sphere{Vec3(12, 12, 12), 2.0 + n},
             .frame = EditFrame::kIndex,
             .operation = EditOperation::kSet,
             .value = 0.0});
    p.SaveVolume(File("t" + std::to_string(n) + ".nrrd"));
  }
  const SeriesResult series = p.LoadSeries({File("t*.nrrd")});
  EXPECT_EQ(series.series.frames, 3u);
  EXPECT_GT(series.series.memory_bytes, 0u);
  const RecordingState started = p.StartRecording(File("a.mcap"));
  EXPECT_TRUE(started.running);
  EXPECT_EQ(Refusal([&] { p.StartRecording(File("b.mcap")); }), ErrorKind::kConflict);
  EXPECT_EQ(p.ControlSeries({.position_frames = 2.0}).series.position_frames, 2.0);
  EXPECT_GT(p.Mark("at the end"), 0);
  ASSERT_TRUE(test::Eventually([&] { return p.GetRecording().ticks > 300; }));
  const RecordingState stopped = p.StopRecording();
  EXPECT_FALSE(stopped.running);
  EXPECT_EQ(stopped.error, "");
  std::vector<std::string> markers;
  const ReplayState last = p.Replay(File("a.mcap"), {.speed = 10.0}, [&](const ReplayState& now) {
    if (!now.marker.empty()) markers.push_back(now.marker);
    return true;
  });
  EXPECT_EQ(last.ticks, stopped.ticks);
  EXPECT_EQ(last.lost_ticks, stopped.lost_ticks);
  EXPECT_EQ(markers, std::vector<std::string>{"at the end"});
  EXPECT_EQ(last.total_ticks, stopped.ticks);
  ASSERT_EQ(last.markers.size(), 1u);
  EXPECT_EQ(last.markers[0].text, "at the end");
  const ReplayState rest = p.Replay(File("a.mcap"), {.speed = 10.0, .first_tick = 250});
  EXPECT_EQ(rest.ticks, stopped.ticks);
  EXPECT_EQ(Refusal([&] { p.Replay(File("a.mcap"), {.first_tick = stopped.ticks}); }),
            ErrorKind::kInvalidArgument);
  const RecordingList list = p.ListRecordings();
  ASSERT_EQ(list.recordings.size(), 1u);
  EXPECT_EQ(list.recordings[0].path, File("a.mcap"));
  EXPECT_EQ(list.recordings[0].size_bytes, stopped.size_bytes);
  EXPECT_EQ(list.folder + "/a.mcap", File("a.mcap"));
  EXPECT_EQ(
      Refusal([&] { p.Replay(File("a.mcap"), {.speed = 0.001}, [](auto&) { return false; }); }),
      ErrorKind::kCancelled);
}

// Follows every tick on a connection of its own, and remembers where the revisions begin.
class FirstTicks {
 public:
  explicit FirstTicks(const Server& server) : calls_(server), thread_([this] { Run(); }) {}
  ~FirstTicks() {
    stop_ = true;
    thread_.join();
  }

  struct Begin {
    Pose before{}, first{};
  };
  // The first sample of this volume or a later one. None if the stream lost the sample before it.
  std::optional<Begin> Await(std::uint64_t volume_revision) {
    std::optional<Begin> begin;
    EXPECT_TRUE(test::Eventually([&] {
      const std::lock_guard lock(mutex_);
      const auto found = begins_.lower_bound(volume_revision);
      if (found == begins_.end()) return false;
      const auto& [before, first] = found->second;
      if (before.tick + 1 == first.tick) begin = found->second;
      return true;
    }));
    return begin;
  }

 private:
  void Run() {
    PoseReader reader = calls_.ReadPoses(1000.0, 20);
    for (Pose last; !stop_;) {
      const std::optional<PoseBatch> batch = reader.Next(50ms);
      const std::lock_guard lock(mutex_);
      for (const Pose& pose : batch ? batch->poses : std::vector<Pose>()) {
        if (pose.volume_revision > last.volume_revision) {
          begins_[pose.volume_revision] = {last, pose};
        }
        last = pose;
      }
    }
  }

  Calls calls_;
  std::mutex mutex_;
  std::map<std::uint64_t, Begin> begins_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

// Others change settings all the while, so that some scenes are skipped.
TEST_F(SdkCalls, TheTickThatIsNamedIsTheFirstOne) {
  Calls& p = *palpated_;
  SaveAsNrrd(p.DownloadVolume().volume, File("sent.nrrd"));
  const std::vector<std::string> frames = {File("t0.nrrd"), File("t1.nrrd"), File("t2.nrrd")};
  for (int n = 0; n < 3; ++n) {
    p.LoadVolume("builtin:sphere:24");
    p.Apply({.shape = Sphere{Vec3(12, 12, 12), 2.0 + n},
             .frame = EditFrame::kIndex,
             .operation = EditOperation::kSet,
             .value = 0.0});
    p.SaveVolume(frames[static_cast<std::size_t>(n)]);
  }
  FirstTicks stream(server());
  std::atomic<bool> stop = false;
  std::thread other([&] {
    Calls calls(server());
    for (int n = 0; !stop; ++n) calls.Set({.damping_n_s_per_m = n % 2 * 0.5});
  });
  constexpr int kEach = 100;
  int named = 0, judged = 0, tries = 0;
  // Where the stream lost samples, there is nothing to judge: it is done once more.
  const auto judge = [&](std::uint64_t volume_revision, std::uint64_t applied_tick,
                         std::uint64_t settings_revision) {
    const auto begin = stream.Await(volume_revision);
    if (!begin) return;
    ++judged;
    const bool is_first =
        begin->first.tick == applied_tick && begin->before.volume_revision < volume_revision;
    // The settings of the load came with the volume.
    const bool is_with_settings = begin->before.settings_revision < settings_revision &&
                                  begin->first.settings_revision >= settings_revision;
    named += is_first && (settings_revision == 0 || is_with_settings);
  };
  const auto repeat = [&](const std::function<void(int n)>& change) {
    named = judged = tries = 0;
    while (judged < kEach && tries < 20 * kEach) change(tries++);
    EXPECT_EQ(judged, kEach) << "the stream of poses lost samples at most changes";
    EXPECT_EQ(named, judged);
  };
  const auto stiffness = [](int n) {
    return SettingsUpdate{.stiffness_n_per_mm = 0.3 + n % 2 * 0.1};
  };
  repeat([&](int n) {
    const LoadResult loaded = p.LoadVolume(n % 2 ? "builtin:sphere:24" : "builtin:bumps:24",
                                           {.discard_edits = true, .settings = stiffness(n)});
    judge(loaded.volume.volume_revision, loaded.applied_tick, loaded.settings_revision);
  });
  repeat([&](int n) {
    const LoadResult sent =
        p.UploadVolume(File("sent.nrrd"), {.discard_edits = true, .settings = stiffness(n)});
    judge(sent.volume.volume_revision, sent.applied_tick, sent.settings_revision);
  });
  const SeriesResult series = p.LoadSeries(frames, {.settings = stiffness(3)});
  EXPECT_EQ(p.GetSettings().stiffness_n_per_mm, 0.4);
  judge(series.series.volume_revision, series.applied_tick, series.settings_revision);
  EXPECT_EQ(named, judged);
  repeat([&](int n) {
    const SeriesControlled sought = p.ControlSeries({.position_frames = 1 + n % 2});
    EXPECT_EQ(sought.series.position_frames, 1 + n % 2);
    judge(sought.series.volume_revision, sought.applied_tick, 0);
  });
  stop = true;
  other.join();
}

TEST_F(SdkCalls, TheDeviceIsListedStoppedAndEnabled) {
  Calls& p = *palpated_;
  const DaemonInfo info = p.GetDevice();
  EXPECT_EQ(info.caller.role, Role::kAdmin);
  const std::vector<ListedDevice> list = p.ListDevices();
  EXPECT_EQ(std::count_if(list.begin(), list.end(), [](auto& device) { return device.in_use; }), 1);
  const ForceResult stopped = p.StopForces();
  EXPECT_EQ(stopped.forces.state, ForceState::kStopped);
  EXPECT_EQ(p.GetDevice().forces.reason, ForceReason::kStopCall);
  PoseReader reader = p.ReadPoses(1000.0, 1);
  std::optional<PoseBatch> batch;
  ASSERT_TRUE(test::Eventually([&] {
    batch = reader.Next(50ms);
    return batch && batch->poses.front().tick >= stopped.applied_tick;
  }));
  EXPECT_EQ(batch->poses.front().forces.state, ForceState::kStopped);
  EXPECT_EQ(batch->poses.front().force_n.norm(), 0.0);
  EXPECT_NE(p.EnableForces().forces.state, ForceState::kStopped);
  EXPECT_EQ(p.DisableForces().forces.reason, ForceReason::kOperator);
}

TEST_F(SdkCalls, FuturesRunBesideEachOtherAndEnd) {
  Calls& p = *palpated_;
  auto loading = p.Async([](Calls& c) { return c.LoadVolume("builtin:bumps:64"); });
  auto device = p.Async([](Calls& c) { return c.GetDevice(); });
  EXPECT_EQ(device.get().device.kind, "simulated");
  EXPECT_EQ(loading.get().volume.size, Vec3i(64, 64, 64));
  std::atomic<bool> runs = false;
  auto endless = p.Async([&runs](Calls& c) {
    return c.RunFilter({.kind = FilterKind::kMedian, .width = 3, .iterations = 10},
                       [&runs](const Progress&) { return runs = true; });
  });
  ASSERT_TRUE(test::Eventually([&] { return runs.load(); }));
  p.EndCalls();
  EXPECT_EQ(Refusal([&] { endless.get(); }), ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { p.GetVolume(); }), ErrorKind::kCancelled);
}

// The daemon goes away under a call that waits for it.
TEST_F(SdkCalls, ADaemonThatGoesIsSaid) {
  PoseReader reader = palpated_->ReadPoses(100.0, 1);
  daemon_.Kill();
  EXPECT_EQ(Refusal([&] {
              while (true) reader.Next(50ms);
            }),
            ErrorKind::kUnavailable);
}

}  // namespace
}  // namespace palpate::client
