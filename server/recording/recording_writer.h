// Writes a recording to its file. When EndChunk returns, all that was appended is kept even if the
// program is killed.
//
// Calls must come in the order of ticks. Ticks that were left out are declared as lost. Scenes,
// edits, events and keyframes come before the sample of their tick.
//
// Threads: one at a time. Not for real-time code.
// Errors: Error of the output (kDiskFull); what was written before stays readable, and the next
// EndChunk tries again. kInvalidArgument for a tick before the last one.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/recording/mcap.h"
#include "server/recording/recording.h"

namespace palpate {

// The destination of a recording's bytes.
//
// Threads: one at a time. Not for real-time code (waits for the disk).
class RecordingOutput {
 public:
  virtual ~RecordingOutput() = default;
  // After the return, all bytes are kept even if the program is killed. Throws Error; then none of
  // the bytes are kept.
  virtual void Append(std::string_view bytes) = 0;
  // After the return, the bytes are kept even if the power fails.
  virtual void Sync() = 0;
};

// About a minute and a half of ticks.
inline constexpr std::uint64_t kLeastRoomBytes = std::uint64_t{16} << 20;

// Makes a new file, which takes its name with the first Append. So at any time `path` is either
// unchanged or begins with all bytes of the first Append, even if the program is killed. A power
// cut loses about the last second: syncing every chunk would be too slow while a user drags
// settings.
//
// Throws Error: kConflict if `path` exists and `overwrite` is false, or if it exists and is no
// recording; kDiskFull if the disk has less room than kLeastRoomBytes and `voxel_bytes`, those that
// are stored at once; the errors of CannotWrite if the file cannot be written. Append throws
// kConflict if `path` was made in the meantime; kDiskFull. `now`: the clock for the second between
// two syncs; tests pass their own.
std::unique_ptr<RecordingOutput> CreateRecordingFile(
    const std::filesystem::path& path, bool overwrite, std::uint64_t voxel_bytes = 0,
    std::function<std::chrono::steady_clock::time_point()> now = std::chrono::steady_clock::now);

struct RecordingCounts {
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;  // within gaps
  std::uint64_t bytes = 0;
};

class RecordingWriter {
 public:
  // Writes the header. `program`: its name and version.
  RecordingWriter(std::unique_ptr<RecordingOutput> output, const std::string& program);

  RecordingWriter(const RecordingWriter&) = delete;
  RecordingWriter& operator=(const RecordingWriter&) = delete;

  void Append(const TickSample& sample);
  void Append(const RecordedScene& scene);
  void Append(const RecordedEdit& edit);
  void Append(const RecordedEvent& event);
  void Append(const RecordedKeyframe& keyframe);
  // Says what UTC is at time_ns.
  void Append(const RecordedClock& clock);

  // Says that `tick` is the next tick to append. Missing ticks before `tick` are lost.
  void SkipTo(std::uint64_t tick);

  // The samples that EndChunk would write.
  std::size_t waiting_ticks() const { return waiting_ticks_; }
  // Writes what was appended with samples up to now. What belongs to the next sample waits for it.
  void EndChunk();

  // Writes the end. Do not append anything afterwards.
  void AppendEnd();

  // Of what was written.
  const RecordingCounts& counts() const { return counts_; }
  // The tick after the last one; none before the first call with a tick.
  std::optional<std::uint64_t> next_tick() const { return next_tick_; }

 private:
  void Wait(std::uint64_t tick, std::uint16_t channel, std::string message);
  void WriteWaiting();
  std::uint64_t LogTime(std::int64_t time_ns) const;

  std::unique_ptr<RecordingOutput> output_;
  RecordingCounts counts_;
  mcap::Writer file_;
  std::uint16_t tick_ = 0, scene_ = 0, voxels_ = 0, keyframe_ = 0, event_ = 0,
                clock_ = 0;             // channels
  std::int64_t time_from_unix_ns_ = 0;  // from UTC to a tick's time
  // Channel and message: of the next sample, whose time is not known yet.
  std::vector<std::pair<std::uint16_t, std::string>> waiting_;
  std::uint64_t time_ns_;  // of the last message
  std::optional<std::uint64_t> next_tick_;
  std::uint64_t lost_ticks_ = 0;
  std::size_t waiting_ticks_ = 0;
};

}  // namespace palpate
