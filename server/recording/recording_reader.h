// Reads a recording, item by item, up to its end or its first damage.
//
// Never returns numbers that were not recorded. Holds one chunk at a time (kMostItemBytes), however
// large the file is. Other programs may have put topics of their own into the file: they are left
// out.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <optional>
#include <string>

#include "server/recording/mcap.h"
#include "server/recording/recording.h"

namespace palpate {

// True if the stream begins as Palpate writes recordings, whatever the rest is.
bool BeginsAsRecording(std::istream& stream);

class RecordingReader {
 public:
  // Throws Error: kNotFound; kInvalidArgument if the file is not a recording.
  explicit RecordingReader(const std::filesystem::path& file);
  // `name`: used in messages.
  RecordingReader(std::unique_ptr<std::istream> stream, std::string name);
  ~RecordingReader();

  const RecordingHeader& header() const { return header_; }

  // Returns none at the end.
  std::optional<RecordedItem> Next();

  std::uint64_t ticks() const { return ticks_; }            // read so far
  std::uint64_t lost_ticks() const { return lost_ticks_; }  // in the gaps read so far
  // True if the recording was closed and has been read to its end.
  bool complete() const { return complete_; }
  // One line that says why reading stopped early; empty if it did not.
  const std::string& stopped_because() const { return stopped_because_; }

 private:
  struct Messages;

  std::optional<RecordedItem> Read();
  // The next message of ours; samples are one sample. None at the end of the file.
  std::optional<RecordedItem> ReadItem();
  // None for a message of others, or of no use here.
  std::optional<RecordedItem> ItemOf(const mcap::Message& message);
  std::optional<RecordedItem> ReadEnd();
  void Extend(RecordedSamples& samples);
  RecordedItem GapUntil(std::uint64_t tick);
  void StopBecause(const std::string& what);

  std::string name_;
  std::unique_ptr<mcap::Reader> file_;
  std::unique_ptr<Messages> messages_;  // parsed into, again and again
  RecordingHeader header_;
  std::optional<RecordedItem> pending_;  // was read, but not returned
  std::string damage_;                   // behind what was read
  std::optional<std::uint64_t> next_tick_;
  std::uint64_t ticks_ = 0;
  std::uint64_t lost_ticks_ = 0;
  std::uint64_t edit_bricks_ = 0;  // that lead to the next scene
  bool complete_ = false;
  std::string stopped_because_;
};

}  // namespace palpate
