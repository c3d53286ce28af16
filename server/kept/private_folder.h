// Temporary folders that no other user can enter. They are removed automatically.
//
// Threads: any ordinary thread.
#pragma once

#include <filesystem>
#include <string_view>

namespace palpate {

// $TMPDIR, or /tmp if it is not set.
std::filesystem::path TemporaryFolder();

// The destructor removes the folder with all its files.
class PrivateFolder {
 public:
  // Makes PARENT/PREFIX followed by the process and a unique suffix. Throws Error (kUnavailable).
  PrivateFolder(const std::filesystem::path& parent, std::string_view prefix);
  ~PrivateFolder();
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Removes folders of processes that were killed. The folder's name tells the process. Only folders
// of this user can be removed.
void RemoveAbandonedFolders(const std::filesystem::path& parent, std::string_view prefix);

}  // namespace palpate
