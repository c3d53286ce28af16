// Writes a recording, chunk by chunk; each is kept when its call returns, even if
// the program is killed.
//
// Calls come in the order of ticks. Ticks between them that were not appended
// are declared as a gap by the next call.
//
// Threads: one at a time. Not for real-time code.
// Errors: Error of the output (kUnavailable: the disk is full); what was written
// before stays readable. kInvalidArgument for a tick before the last one.
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
  void Append(const RecordedMarker& marker) { AppendEvent(marker.tick, marker); }
  void Append(const RecordedKeyframe& keyframe) { AppendEvent(keyframe.tick, keyframe); }

  // The next tick to append is `tick`: those before it that are missing are lost.
  void SkipTo(std::uint64_t tick);

  // Nothing may be appended after it.
  void AppendEnd();

  const RecordingCounts& counts() const { return counts_; }
  // The tick after the last one; none before the first call with one.
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
