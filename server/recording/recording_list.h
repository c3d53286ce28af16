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
  std::int64_t modified_s = 0;  // since 1970, UTC; 0 to the end of the year 9999
};

struct ListBounds {
  std::size_t recordings = 1000;  // that are listed
  // That are looked at; above 0. A folder may hold any number of other files.
  std::size_t files = 10'000;
};

// The newest recordings of these folders, newest first, without the folders within them. A file is
// a recording if it begins as one, whatever its name. `open`: opens a file that the client may
// replay, and throws Error for all others; those are not listed. Of more files
// than the bounds say, only the newest are looked at. Memory: of twice as many. Files whose names
// are not UTF-8 are not listed. A folder that cannot be read has no recordings.
std::vector<ListedRecording> FindRecordings(
    const std::vector<std::filesystem::path>& folders,
    const std::function<std::unique_ptr<std::istream>(const std::string&)>& open,
    const ListBounds& bounds = {});

// The first of the folders; empty if there is none, or if its name is not UTF-8.
std::filesystem::path FolderForNew(const std::vector<std::filesystem::path>& folders);

}  // namespace palpate
