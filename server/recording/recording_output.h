// Where the bytes of a recording go.
//
// Threads: one at a time. Not for real-time code (waits for the disk).
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <string_view>

namespace palpate {

class RecordingOutput {
 public:
  virtual ~RecordingOutput() = default;
  // All of the bytes are kept when this returns, also if the program is killed
  // then. Throws Error, and keeps none of them then.
  virtual void Append(std::string_view bytes) = 0;
  // Also if the power goes.
  virtual void Sync() = 0;
};

// A new file. It takes its name with the first Append, so that at any time `path`
// is as it was or begins with whole bytes of that Append, even when the program
// is killed. A power cut costs about the last second: to sync every chunk would
// be too slow for settings that are dragged about.
//
// Throws Error: kConflict where `path` is there, unless `overwrite`; as CannotWrite where nothing
// can be written. Append: kConflict where `path` has come to be in between; kDiskFull. `now`: the
// clock of the second between two syncs; tests bring their own.
std::unique_ptr<RecordingOutput> CreateRecordingFile(
    const std::filesystem::path& path, bool overwrite,
    std::function<std::chrono::steady_clock::time_point()> now = std::chrono::steady_clock::now);

}  // namespace palpate
