// Reads a recording, chunk by chunk, up to its end or its first damaged chunk.
//
// Never returns numbers that were not recorded. Holds one chunk (16 MiB) at a time, however large
// the file is.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <optional>
#include <string>

#include "server/recording/recording.h"

namespace palpate {

class RecordingReader {
 public:
  // Throws Error: kNotFound; kInvalidArgument if the file is not a recording.
  explicit RecordingReader(const std::filesystem::path& file);
  // `name`: used in messages.
  RecordingReader(std::unique_ptr<std::istream> stream, std::string name);

  const RecordingHeader& header() const { return header_; }

  // Returns none at the end.
  std::optional<RecordedChunk> Next();

  std::uint64_t ticks() const { return ticks_; }            // read so far
  std::uint64_t lost_ticks() const { return lost_ticks_; }  // in the gaps read so far
  // True if the recording was closed and has been read to its end.
  bool complete() const { return complete_; }
  // One line that says why reading stopped early; empty if it did not.
  const std::string& stopped_because() const { return stopped_because_; }

 private:
  void Check(const RecordedChunk& chunk);
  void CheckEnd(const RecordedEnd& end);
  void StartAt(std::uint64_t tick);
  void StopBecause(const std::string& what);

  std::unique_ptr<std::istream> stream_;
  std::string name_;
  RecordingHeader header_;
  std::uint64_t next_number_ = 0;
  std::optional<std::uint64_t> next_tick_;
  std::uint64_t ticks_ = 0;
  std::uint64_t lost_ticks_ = 0;
  bool complete_ = false;
  std::string stopped_because_;
};

}  // namespace palpate
