// Folders for files on their way, which nobody else can enter and nobody has to
// clean up.
//
// Any ordinary thread.
#pragma once

#include <filesystem>
#include <string_view>

namespace palpate {

// $TMPDIR, else /tmp.
std::filesystem::path TemporaryFolder();

// Removed with all it holds.
class PrivateFolder {
 public:
  // PARENT/PREFIX, the process, and what makes it unique. Throws Error
  // (kUnavailable).
  PrivateFolder(const std::filesystem::path& parent, std::string_view prefix);
  ~PrivateFolder();
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Removes what processes left that were killed: the name holds the process, and
// only our own can be removed.
void RemoveAbandonedFolders(const std::filesystem::path& parent, std::string_view prefix);

}  // namespace palpate
