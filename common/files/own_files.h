// Files that no client may have read, or written over, wherever they lie: the daemon's keys,
// tokens, configuration and state, and what the kernel tells of processes.
//
// Any thread; asks the file system. A file is known by what it is, not by its name: links and ".."
// are followed, and another name of the same file (a hard link) is found by its number.
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <vector>

namespace palpate {

class OwnFiles {
 public:
  // Besides /proc and /sys, which always are: files and folders, there or not yet, absolute.
  explicit OwnFiles(std::vector<std::filesystem::path> paths = {});

  // Whether it is one of them, or lies in one.
  bool Hold(const std::filesystem::path& file) const;
  // The same of an open file, whatever its name is by now.
  bool HoldOpen(int descriptor) const;

  const std::vector<std::filesystem::path>& paths() const { return paths_; }

 private:
  bool HoldReal(const std::filesystem::path& real, const struct stat& file) const;

  std::vector<std::filesystem::path> paths_;
};

}  // namespace palpate
