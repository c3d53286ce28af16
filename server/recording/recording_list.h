// Finds the recordings in the folders to which clients save.
//
// Threads: any; asks the file system. Not for real-time code.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <istream>
#include <memory>
#include <string>
#include <vector>

namespace palpate {

struct ListedRecording {
  std::filesystem::path path{};
  std::uint64_t size_bytes = 0;
  std::int64_t modified_s = 0;  // since 1970, UTC
};

inline constexpr std::size_t kMostListedRecordings = 1000;
// A folder may hold any number of other files.
inline constexpr std::size_t kMostFilesLookedAt = 10'000;

// The newest recordings of these folders, newest first, without the folders within them. A file is
// a recording if it begins as one, whatever its name. `open`: opens a file that the client may
// replay, and throws Error for all others; those are not listed. Of more than kMostFilesLookedAt
// files, only the newest are looked at. Files whose names are not UTF-8 are not listed. A folder
// that cannot be read has no recordings.
std::vector<ListedRecording> FindRecordings(
    const std::vector<std::filesystem::path>& folders,
    const std::function<std::unique_ptr<std::istream>(const std::string&)>& open);

}  // namespace palpate
