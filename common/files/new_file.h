// Writes files that are always complete or unchanged, also after a power failure.
//
// The bytes go into a file without a name in the path's folder. When they are on the disk, the file
// gets a name next to the path, "NAME.XXXXXX.partial", and is renamed to the path. When the rename
// returns, the new name is on the disk, too. So a killed program leaves nothing behind, unless it
// is killed within the moment before the rename, or the file system (NFS) wants a name from the
// beginning. Existing files are never opened, so a link or a pipe with such a name has no effect.
//
// Any thread. Not for real-time code: waits for the disk.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "common/error/error.h"

namespace palpate {

// kReplace: a regular file, and nothing else: no device, pipe, link or folder.
enum class IfThere { kReplace, kRefuse };
inline IfThere ReplacesIf(bool overwrite) {
  return overwrite ? IfThere::kReplace : IfThere::kRefuse;
}
// kNo does not wait for the disk: for files that another program reads at once and removes.
enum class Durable { kYes, kNo };
// kRefused: for a checked path without links. If a link has since come into the folder's name, the
// file is not written.
enum class Links { kFollowed, kRefused };

// The Error for a file that cannot be written, by errno: kNotFound (no such folder),
// kInvalidArgument (the path is a folder), kPermissionDenied, kDiskFull, kTooLarge (too many files
// are open), otherwise kUnavailable.
Error CannotWrite(const std::filesystem::path& path, int error_number);

class NewFile {
 public:
  // Makes the file. `mode`: reduced by the process's umask. Throws Error: those of
  // CannotWrite; kConflict if `path` exists and must not be replaced; kInvalidArgument if it exists
  // and cannot be; kPermissionDenied for a link in the folder's name.
  explicit NewFile(std::filesystem::path path, IfThere if_there = IfThere::kReplace,
                   mode_t mode = 0666, Links links = Links::kFollowed);
  // Removes the file unless it has taken its name.
  ~NewFile();
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  int descriptor() const { return descriptor_; }
  bool has_name() const { return has_name_; }

  // Writes all bytes. Throws CannotWrite; some bytes may be written then.
  void Write(std::string_view bytes);
  // Returns when the bytes are on the disk. Throws CannotWrite.
  void Sync();
  // Syncs the file, renames it, and syncs its folder; if not durable, only renames it. Throws
  // CannotWrite, or kConflict if `path` has come to exist meanwhile and must not be replaced. After
  // an error `path` is unchanged, unless the disk failed while syncing the folder: has_name()
  // tells.
  void TakeName(Durable durable = Durable::kYes);

 private:
  bool GivePartialName(const std::function<bool(const char* name)>& make);
  bool RenameTo(unsigned flags) const;
  void Rename();
  void ClaimAndRename();

  const std::filesystem::path path_;
  const IfThere if_there_;
  // All operations use this folder, even if its name leads elsewhere by now.
  int directory_ = -1;
  std::string partial_name_;  // empty: the file has no name yet
  int descriptor_ = -1;
  bool has_name_ = false;
};

// Makes the file for code that writes to a path: `write` fills the partial file. If `write` fails,
// it throws std::ios_base::failure or any Error. Throws that Error, or one of NewFile's.
void WriteWhole(const std::filesystem::path& path,
                const std::function<void(const std::filesystem::path& partial)>& write,
                IfThere if_there = IfThere::kReplace, Durable durable = Durable::kYes,
                Links links = Links::kFollowed);

// Call it before long work: throws what NewFile would throw.
void CheckNewFile(const std::filesystem::path& path, IfThere if_there);

// Makes a folder and missing folders above it. Their names survive a power failure. Throws
// CannotWrite.
void MakeFolders(const std::filesystem::path& folder);

}  // namespace palpate
