// Recordings and replays of a running session: servo, pump and session as in the daemon, without
// gRPC.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "server/client_paths/path_policy.h"
#include "server/recording/recording_control.h"
#include "server/recording/replayer.h"
#include "server/simulated_hand/explore_script.h"
#include "tests/support/running_session.h"
#include "tests/support/scene_rig.h"
#include "tests/support/temporary_folder.h"

namespace palpate::testing {

inline const ReplayReports kUnwatched = [](const ReplayReport&) {};

// All that a viewer, or a tool, gets.
class Collector final : public SampleSink {
 public:
  void OnSample(const TickSample& sample) override {
    const std::lock_guard lock(mutex_);
    samples_.push_back(sample);
  }
  std::vector<TickSample> Take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(samples_, {});
  }

 private:
  std::mutex mutex_;
  std::vector<TickSample> samples_;
};

inline std::filesystem::path Allowed(const std::string& path) {
  if (path.find("forbidden") != std::string::npos) {
    throw Error(ErrorKind::kPermissionDenied, "not there");
  }
  return path;
}

inline std::unique_ptr<std::istream> OpenAllowed(const std::string& path) {
  return PathPolicy({.load_folders = {"/"}}).OpenToLoad(Allowed(path));
}

class RecordingControlRig : public ::testing::Test, protected RunningSession {
 protected:
  RecordingControlRig() : RunningSession({}, Exploring()) {}
  void SetUp() override {
    Load("builtin:gyroid:32");
    Start();
    AwaitTicks(20);
  }
  void TearDown() override { RunningSession::Stop(); }

  static std::unique_ptr<StylusScript> Exploring() {
    const DeviceDescription spec = SimulatedDeviceSpec();
    return std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, 1);
  }
  std::string File(const std::string& name) const { return (folder_.path() / name).string(); }
  void Edit(std::mt19937_64& random) {
    session().store().Edit([&](const auto& present) { return Carve(*present, random); });
  }
  VolumeHash LiveHash() const { return HashVolume(*volume()); }
  VolumeHash ShownHash() { return HashVolume(*session().shown().volume().volume); }

  // Some hundred ticks with edits; the volume is as before afterwards. Returns its samples.
  std::vector<TickSample> RecordEdits(const std::string& name, bool restore = true) {
    const auto before = volume();
    control_.Start(File(name), false);
    std::mt19937_64 random(1);
    AwaitTicks(100);
    for (int n = 0; n < 10; ++n) {
      session().Update({.normalized_isovalue = 0.4 + 0.02 * n,
                        .flags = {{&HapticSettings::passivity_control, n % 2 == 1}}});
      session().SetForcesOff(n == 5);
      Edit(random);
      AwaitTicks(30);
      session().SetForcesOff(false);
      control_.Mark("edit " + std::to_string(n));
    }
    recorded_hash_ = LiveHash();
    AwaitTicks(100);
    const RecordingStatus stopped = control_.Stop();
    EXPECT_FALSE(stopped.error);
    EXPECT_EQ(stopped.counts.bytes, std::filesystem::file_size(File(name)));
    // Computed again it is the same, though several threads have made it.
    const ReplayCounts counts = ComputeAgain(name, before);
    EXPECT_EQ(counts.ticks, stopped.counts.ticks);
    EXPECT_EQ(counts.differing + counts.differing_keyframes + counts.without_volume, 0u);
    // The scene may be newer than the tick at which it began.
    EXPECT_LE(counts.without_start + counts.without_scene,
              (1 + counts.gaps) * (kKeyframeTicks + 2));
    EXPECT_GT(counts.edits, 5u);
    EXPECT_EQ(counts.markers, 10u);
    if (restore) {
      session().store().Edit(
          [&](const auto& present) { return present->bricks().ChangesTo(before->bricks()); });
    }
    RecordingReader reader(File(name));
    const std::vector<TickSample> samples = SamplesIn(ReadAll(reader));
    EXPECT_TRUE(reader.complete());
    return samples;
  }

  std::uint64_t RecordedTicks(const std::string& name) const {
    RecordingReader reader(File(name));
    return SamplesIn(ReadAll(reader)).size();
  }
  ReplayCounts ComputeAgain(const std::string& name,
                            const std::shared_ptr<const VolumeSnapshot>& volume) {
    Replayer replayer([&](const RecordedScene&) { return volume; });
    RecordingReader reader(File(name));
    while (const std::optional<RecordedItem> item = reader.Next()) replayer.Take(*item);
    EXPECT_TRUE(reader.complete()) << reader.stopped_because();
    return replayer.counts();
  }

  test::TemporaryFolder folder_;
  std::atomic<int> opened_{0};  // files
  RecordingControl control_{
      session(),
      pump(),
      {Allowed,
       [this](const std::string& path) { return ++opened_, OpenAllowed(path); },
       {folder_.path()}},
      "test",
      SafetyLimits{},
      PassivityDevice{}};
  VolumeHash recorded_hash_;
};

}  // namespace palpate::testing
