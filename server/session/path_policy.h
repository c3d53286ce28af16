// Which files clients may have the daemon read and write.
//
// A client names files on the daemon's machine; the daemon may see more of that
// machine than the client should. Paths are judged by where they lead: symbolic
// links and ".." are followed first. Someone who changes links on this machine
// between the judgement and the use meets the kernel (server/import/confinement.h, OpenToLoad,
// common/files/new_file.h). Not covered: palpated's own files in a folder that clients may load
// from, if somebody on this machine renames them while they are looked at.
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
  // Absolute paths of folders. Empty: nothing may be loaded, or saved.
  std::vector<std::filesystem::path> load_folders{};
  std::vector<std::filesystem::path> save_folders{};
  // Neither loaded nor saved to, whatever the lists say.
  OwnFiles own_files{};
};

// The folder that the process was started in: where clients load from and save to by default.
std::filesystem::path CurrentFolder();

class PathPolicy {
 public:
  // The configuration's names of the lists, for messages.
  static constexpr char kLoadKey[] = "volume.load_folders";
  static constexpr char kSaveKey[] = "volume.save_folders";

  // From nowhere, to nowhere.
  PathPolicy() : PathPolicy(PathPolicyOptions{}) {}
  // Throws Error (kInvalidArgument) for a path that is not absolute or no folder.
  explicit PathPolicy(const PathPolicyOptions& options);

  // Whether it can be a path, and be told back in one line. Throws Error
  // (kInvalidArgument): too long, control characters.
  static void CheckText(const std::string& path);

  // Where a file or folder to load lies, links followed; "builtin:..." stays as it
  // is. Whether it is there is left to those who open it.
  // Throws Error: kInvalidArgument (not absolute, as CheckText), kPermissionDenied.
  std::filesystem::path CheckLoad(const std::string& path) const;

  // The same, opened: a regular file. Links that have come meanwhile are not followed.
  // Throws Error: as CheckLoad; kInvalidArgument (no regular file), kNotFound.
  std::unique_ptr<std::istream> OpenToLoad(const std::string& path) const;

  // Where a file to write lies, links followed. Its folder is there; it itself is a
  // regular file or not there.
  // Throws Error: kInvalidArgument (not absolute, as CheckText, no name, no
  // regular file),
  // kNotFound (no such folder), kPermissionDenied.
  std::filesystem::path CheckSave(const std::string& path) const;

  // Links followed.
  const std::vector<std::filesystem::path>& load_folders() const { return load_folders_; }

 private:
  std::vector<std::filesystem::path> load_folders_;
  std::vector<std::filesystem::path> save_folders_;
  OwnFiles own_files_;
};

}  // namespace palpate
