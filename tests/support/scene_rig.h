// A servo, a recorder and edited volumes, tick by tick on one thread. It does the work of daemon
// and session without their threads.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/felt/felt_surface.h"
#include "server/pump/pose_of.h"
#include "server/recording/recorded_scenes.h"
#include "server/recording/recorder.h"
#include "server/servo/servo_tick.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/made_volume.h"
#include "tests/support/patience.h"
#include "tests/support/recording.h"

namespace palpate::testing {

// Carves bricks of `volume` around a middle brick by a random amount.
inline std::vector<BrickChange> Carve(const VolumeSnapshot& volume, std::mt19937_64& random) {
  std::vector<BrickChange> changes;
  const Vec3i count = volume.bricks().brick_count();
  const Vec3i first(static_cast<int>(random() % (count.x() - 1)),
                    static_cast<int>(random() % (count.y() - 1)),
                    static_cast<int>(random() % (count.z() - 1)));
  for (int n = 0; n < 8; ++n) {
    const Vec3i brick = first + Vec3i(n >> 2, n >> 1 & 1, n & 1);
    Brick values = volume.bricks().At(brick)->Floats();
    for (float& value : values) value -= static_cast<float>(random() % 1000) * 1e-4f;
    changes.push_back({brick, Leaf::Of(LeafType::kFloat, values)});
  }
  return changes;
}

class SceneRig {
 public:
  explicit SceneRig(std::shared_ptr<const VolumeSnapshot> volume,
                    const DeviceDescription& spec = SimulatedDeviceSpec())
      : device_(std::make_unique<ExploreScript>(Vec3(-80, -60, -35), Vec3(80, 60, 35), 1), spec),
        tick_(device_) {
    device_.Start();
    scene_.settings.damping_n_s_per_m = 0.7;
    scene_.settings.static_friction = 0.4;
    scene_.settings.dynamic_friction = 0.3;
    volume_ = std::move(volume);
    tau_ = 0.47;
    Publish(0);
  }

  // Starts a recording.
  void Record(std::unique_ptr<RecordingOutput> output) {
    recorder_ = std::make_unique<Recorder>(std::move(output), "test");
    Note(0);
  }
  RecorderReport Stop() { return recorder_->Stop(); }
  Recorder& recorder() { return *recorder_; }

  // One tick at a time of the test's.
  TickSample Tick(const TickTime& time) {
    TickSample sample = tick_.Run(scene_, time);
    AddScpV(scene_, *cells_, sample);
    return sample;
  }
  // Runs ticks. Lost ticks are computed, but not delivered.
  void Run(int ticks, bool lost = false) {
    for (int n = 0; n < ticks; ++n) {
      const ServoKeyframe keyframe = tick_.Keyframe();
      const bool due = keyframe.tick % kKeyframeTicks == 0;
      const TickSample sample = Tick({.missed = missed_});
      if (!recorder_ || lost) continue;
      if (due) recorder_->OnKeyframe(keyframe);
      recorder_->OnSample(sample);
      if (++delivered_ % kSamplesPerChunk == 0) AwaitRecorder();
    }
  }

  void Edit(const std::vector<BrickChange>& changes) {
    volume_ = WithChanges(*volume_, changes);
    revision_ = volume_->revision();
    Publish(changes.size() * sizeof(Brick));
  }
  // As a series does, whose volume is not reloadable.
  void ShowFrame(double position_frames, const BrickDirectory& frame) {
    scene_.series_position_frames = position_frames;
    Edit(volume_->bricks().ChangesTo(frame));
  }
  // Loads another volume. Its revision must be revision().
  void Load(std::shared_ptr<const VolumeSnapshot> volume) {
    volume_ = std::move(volume);
    ++revision_;
    Publish(0);
  }
  std::uint64_t next_revision() const { return revision_ + 1; }
  void Set(double tau, const HapticSettings& settings) {
    tau_ = tau;
    scene_.settings = settings;
    Publish(0);
  }
  // A ball of this radius; none: a point.
  void SetBall(const std::optional<double>& radius_mm, bool is_least) {
    tip_ = {};
    if (radius_mm) {
      tip_.fields.emplace_back(palpate::Ball{*radius_mm, 1.7 * Mat3::Identity(), is_least},
                               *volume_);
    }
    geometry_revision_ += 1000;
    Publish(0);
  }
  // The fields of its radii are of the greatest values.
  void SetTool(const HeldTool& tool) {
    std::vector<FeltBall> fields;
    for (const double radius_mm : RadiiOf(tool)) {
      if (radius_mm > 0.0) {
        fields.emplace_back(palpate::Ball{radius_mm, 1.7 * Mat3::Identity(), false}, *volume_);
      }
    }
    tip_ = MakeTip(tool, std::move(fields));
    geometry_revision_ += 1000;
    Publish(0);
  }
  void SetForcesOff(bool off) {
    scene_.forces_off = off;
    Publish(0);
  }
  void Miss(std::uint64_t ticks) { missed_ += ticks; }

  const HapticSettings& settings() const { return scene_.settings; }
  const std::shared_ptr<const VolumeSnapshot>& volume() const { return volume_; }
  SimulatedDevice& device() { return device_; }

 private:
  // Only what a test loses on purpose is lost, however slow the recorder's thread is.
  void AwaitRecorder() const {
    EXPECT_TRUE(test::Eventually([&] {
      const RecorderReport report = recorder_->report();
      return report.error || report.counts.ticks + Recorder::kQueueTicks / 2 > delivered_;
    }));
  }
  void Publish(std::uint64_t changed_bytes) {
    ++scene_.scene_revision;
    scene_.volume = volume_;
    scene_.isovalue = volume_->Denormalize(tau_);
    AffineMap X_DI;
    X_DI.linear *= 1.7;
    X_DI.translation = Vec3(-40.0, -40.0, -40.0);
    for (FeltBall& field : tip_.fields) field.Follow(*volume_);
    FeelSurface(X_DI, tau_, geometry_revision_ + revision_, tip_, scene_);
    if (recorder_) Note(changed_bytes);
  }
  void Note(std::uint64_t changed_bytes) {
    recorder_->NoteScene(
        ToRecorded(scene_, HashVolume(*volume_), kTickPeriodS, LimitsFor(device_.spec(), 0),
                   PassivityDeviceOf(device_.spec())),
        volume_, changed_bytes);
  }

  SimulatedDevice device_;
  ServoTick tick_;
  std::unique_ptr<CellCache> cells_ = std::make_unique<CellCache>();
  std::shared_ptr<const VolumeSnapshot> volume_;
  std::uint64_t revision_ = 1;
  std::uint64_t geometry_revision_ = 0;
  FeltTip tip_;
  double tau_ = 0.5;
  Scene scene_;
  std::uint64_t missed_ = 0;
  std::uint64_t delivered_ = 0;
  std::unique_ptr<Recorder> recorder_;
};

}  // namespace palpate::testing
