// Computes the ticks of a recording again and compares them, bit for bit.
//
// From a keyframe on, scenes, edits and the stylus as recorded lead to the same forces
// and positions: all fields of a sample are compared but its times. It starts at the
// first keyframe, and again after each gap and after ticks whose scene or volume the
// recording does not have; at every other keyframe the whole state is compared.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "server/recording/recording.h"
#include "server/recording/recorded_volumes.h"
#include "server/servo/tick_computation.h"

namespace palpate {

struct ReplayCounts {
  std::uint64_t ticks = 0;  // recorded
  std::uint64_t compared = 0;
  std::uint64_t differing = 0;
  std::uint64_t keyframes = 0;  // whose state was compared
  std::uint64_t differing_keyframes = 0;
  // Not compared: before the first keyframe or between a break and the next one;
  // without their scene; without their volume.
  std::uint64_t without_start = 0;
  std::uint64_t without_scene = 0;
  std::uint64_t without_volume = 0;
  std::uint64_t gaps = 0;
  std::uint64_t lost_ticks = 0;  // within gaps
  std::uint64_t scenes = 0;
  std::uint64_t edits = 0;  // applied
  std::uint64_t markers = 0;
  std::uint64_t contacts = 0;  // of the ticks compared
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

  // In the order of the recording. Throws Error: kConflict for keyframes of another
  // version of this program, and for states that no servo has; kInvalidArgument for
  // scenes that contradict each other.
  void Take(const RecordedChunk& chunk);

  const ReplayCounts& counts() const { return counts_; }
  const std::optional<ReplayDifference>& first_difference() const { return difference_; }
  // Why ticks are without their volume; the last reason.
  const std::optional<Error>& volume_error() const { return volume_error_; }

 private:
  void Begin(const RecordedScene& scene);
  void Resume(const RecordedKeyframe& keyframe);
  void Take(const RecordedSamples& samples);
  void Take(const TickSample& sample);
  void Compare(const TickSample& recorded, const TickSample& computed);

  RecordedVolumes follower_;
  std::optional<TickComputation> computation_;
  SafetyLimits safety_{};
  PassivityDevice device_{};
  std::optional<RecordedScene> last_;
  Scene scene_;           // volume null: not known
  bool in_step_ = false;  // computation_ is at the next tick
  ReplayCounts counts_;
  std::optional<ReplayDifference> difference_;
  std::optional<Error> volume_error_;
};

}  // namespace palpate
