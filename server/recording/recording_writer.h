// Writes a recording, chunk by chunk. When a call returns, its chunk is kept even if the program is
// killed.
//
// Calls must come in the order of ticks. If ticks between two calls were not appended, the later
// call declares them as a gap.
//
// Threads: one at a time. Not for real-time code.
// Errors: Error of the output (kUnavailable: the disk is full); earlier chunks stay readable.
// kInvalidArgument for a tick before the last one.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "server/recording/recording.h"
#include "server/recording/recording_output.h"

namespace palpate {

struct RecordingCounts {
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;  // within gaps
  std::uint64_t bytes = 0;
};

class RecordingWriter {
 public:
  // `program`: its name and version, at most kMaxProgramBytes.
  RecordingWriter(std::unique_ptr<RecordingOutput> output, const std::string& program);

  void AppendSamples(std::span<const TickSample> samples);
  void Append(const RecordedScene& scene) { AppendEvent(scene.tick, scene); }
  void Append(const RecordedEdit& edit) { AppendEvent(edit.tick, edit); }
  void Append(const TimedMarker& marker) { AppendEvent(marker.tick, marker); }
  void Append(const RecordedKeyframe& keyframe) { AppendEvent(keyframe.tick, keyframe); }

  // Says that `tick` is the next tick to append. Missing ticks before `tick` are lost.
  void SkipTo(std::uint64_t tick);

  // Writes the end chunk. Do not append anything afterwards.
  void AppendEnd();

  const RecordingCounts& counts() const { return counts_; }
  // The tick after the last one; none before the first call with a tick.
  std::optional<std::uint64_t> next_tick() const { return next_tick_; }

 private:
  void AppendEvent(std::uint64_t tick, const RecordedChunk& event);
  void Write(const RecordedChunk& chunk);

  std::unique_ptr<RecordingOutput> output_;
  std::uint64_t next_number_ = 0;
  std::optional<std::uint64_t> next_tick_;
  RecordingCounts counts_;
};

}  // namespace palpate
