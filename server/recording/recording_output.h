// The destination of a recording's bytes.
//
// Threads: one at a time. Not for real-time code (waits for the disk).
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string_view>

namespace palpate {

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

}  // namespace palpate
