// Computes the ticks of a recording again and compares them, bit for bit.
//
// From a keyframe on, the recorded scenes, edits and stylus positions lead to the same forces and
// positions. All fields of a sample are compared except its times. The replay starts at the first
// keyframe. It starts again after each gap, and after ticks whose scene or volume is not in the
// recording. At every other keyframe, the whole state is compared.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "server/felt/felt_surface.h"
#include "server/recording/recorded_scenes.h"
#include "server/recording/recording.h"
#include "server/servo/tick_computation.h"

namespace palpate {

struct ReplayCounts {
  std::uint64_t ticks = 0;  // recorded
  std::uint64_t compared = 0;
  std::uint64_t differing = 0;
  std::uint64_t keyframes = 0;  // keyframes whose state was compared
  std::uint64_t differing_keyframes = 0;
  // Ticks not compared:
  //   without_start   before the first keyframe, or between a break and the next keyframe
  //   without_scene   their scene is missing
  //   without_volume  their volume is missing
  std::uint64_t without_start = 0;
  std::uint64_t without_scene = 0;
  std::uint64_t without_volume = 0;
  std::uint64_t gaps = 0;
  std::uint64_t lost_ticks = 0;  // within gaps
  std::uint64_t scenes = 0;
  std::uint64_t edits = 0;  // applied
  std::uint64_t markers = 0;
  std::uint64_t contacts = 0;  // compared ticks in contact
};

struct ReplayDifference {
  std::uint64_t tick = 0;
  std::string field{};
  std::string recorded{};
  std::string computed{};
};

class Replayer {
 public:
  explicit Replayer(RecordedVolumeLoader load) : follower_(std::move(load)) {}

  // Takes items in the order of the recording. Throws Error: kConflict for keyframes of another
  // version of this program, and for states that no servo has; kInvalidArgument for scenes that
  // contradict each other.
  void Take(const RecordedItem& item);

  const ReplayCounts& counts() const { return counts_; }
  const std::optional<ReplayDifference>& first_difference() const { return difference_; }
  // The last reason why ticks lack their volume.
  const std::optional<Error>& volume_error() const { return volume_error_; }

 private:
  void Begin(const RecordedScene& scene);
  void Resume(const RecordedKeyframe& keyframe);
  void Take(const RecordedSamples& samples);
  void Take(const TickSample& sample);
  void Compare(const TickSample& recorded, const TickSample& computed);

  RecordedVolumes follower_;
  std::optional<TickComputation> computation_;
  std::unique_ptr<CellCache> cells_;  // for SCP_V
  SafetyLimits safety_{};
  PassivityDevice device_{};
  std::optional<RecordedScene> last_;
  Scene scene_;  // volume is null if it is not known
  FeltTip tip_;
  bool in_step_ = false;  // computation_ is at the next tick
  ReplayCounts counts_;
  std::optional<ReplayDifference> difference_;
  std::optional<Error> volume_error_;
};

}  // namespace palpate
