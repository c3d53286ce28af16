// Files that no client may read or overwrite, wherever they are: the daemon's keys, tokens,
// configuration and state, and the kernel's files about processes.
//
// Any thread; asks the file system. Files are compared by identity, not by name: links and ".." are
// followed, and a hard link is found by its inode number.
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <vector>

namespace palpate {

// Opens a checked path, and not a link that has since been put in its place: like open(), but fails
// with ELOOP if a link is on the way. For absolute paths. Returns a descriptor that the caller
// owns, or -1; errno then says why.
int OpenPlain(const std::filesystem::path& path, int flags);

// Returns a path that leads to an open file, even if its name now leads elsewhere.
std::filesystem::path ByDescriptor(int descriptor);

class OwnFiles {
 public:
  // Absolute paths of files and folders, existing or not. /proc and /sys are always included.
  explicit OwnFiles(std::vector<std::filesystem::path> paths = {});

  // True if `file` is one of them, or lies in one of them.
  bool Hold(const std::filesystem::path& file) const;
  // The same for an open file, whatever its name is now.
  bool HoldOpen(int descriptor) const;

  const std::vector<std::filesystem::path>& paths() const { return paths_; }

 private:
  bool HoldReal(const std::filesystem::path& real, const struct stat& file) const;

  std::vector<std::filesystem::path> paths_;
};

}  // namespace palpate
