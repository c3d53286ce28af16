// Decides which files clients may read and write through the daemon.
//
// A client names files on the daemon's machine, and the daemon may see more of the machine than the
// client should. A path is judged by the place to which it leads: symbolic links and ".." are
// followed first. If somebody on this machine changes links between the judgement and the use, the
// kernel refuses the use (server/import/confinement.h, OpenToLoad, common/files/new_file.h). One
// case is not covered: somebody on this machine renames palpated's own files inside a folder that
// clients may load from, during the check.
//
// Threads: any, at once; asks the file system. Ownership: holds its folders.
#pragma once

#include <filesystem>
#include <istream>
#include <memory>
#include <string>
#include <vector>

#include "common/files/own_files.h"

namespace palpate {

struct PathPolicyOptions {
  // Absolute paths of folders. Clients load from both lists: what a client has saved, clients can
  // load again. They save to save_folders only. With empty lists, they may do neither.
  std::vector<std::filesystem::path> load_folders{};
  std::vector<std::filesystem::path> save_folders{};
  // Never loaded or overwritten, whatever the lists say.
  OwnFiles own_files{};
};

// The folder in which the process was started. By default, clients load from and save to this
// folder.
std::filesystem::path CurrentFolder();

class PathPolicy {
 public:
  // The names of the lists in the configuration, for messages.
  static constexpr char kLoadKey[] = "volume.load_folders";
  static constexpr char kSaveKey[] = "volume.save_folders";

  // Allows neither loading nor saving.
  PathPolicy() : PathPolicy(PathPolicyOptions{}) {}
  // Throws Error (kInvalidArgument) for a path that is not absolute or not a folder.
  explicit PathPolicy(const PathPolicyOptions& options);

  // Checks that the text can be a path, and can be printed in one line. Throws Error
  // (kInvalidArgument) if it is too long or has control characters.
  static void CheckText(const std::string& path);

  // Returns the real path of a file or folder to load, with links followed; "builtin:..." stays
  // unchanged. Does not check that the file exists.
  // Throws Error: kInvalidArgument (not absolute, or as CheckText), kPermissionDenied.
  std::filesystem::path CheckLoad(const std::string& path) const;

  // Checks the path in the same way, and opens the regular file. Does not follow links that were
  // made in the meantime.
  // Throws Error: as CheckLoad; kInvalidArgument (not a regular file), kNotFound.
  std::unique_ptr<std::istream> OpenToLoad(const std::string& path) const;

  // Returns the real path of a file to write, with links followed. The folder must exist. The file
  // must be a regular file or not exist.
  // Throws Error: kInvalidArgument (not absolute, no name, not a regular file, or as CheckText),
  // kNotFound (no such folder), kPermissionDenied.
  std::filesystem::path CheckSave(const std::string& path) const;

  // The real paths of all folders to load from, with links followed.
  const std::vector<std::filesystem::path>& load_folders() const { return load_folders_; }
  // Likewise, to save to.
  const std::vector<std::filesystem::path>& save_folders() const { return save_folders_; }

 private:
  std::vector<std::filesystem::path> load_folders_;
  std::vector<std::filesystem::path> save_folders_;
  OwnFiles own_files_;
};

}  // namespace palpate
