// Files that are whole or as they were, also when the power goes.
//
// What is written goes beside the path first. It takes the path's name once it is on the disk, and
// the name is on the disk when that returns. A program that is killed before leaves a file
// "NAME.XXXXXX.partial" behind; what lay there already is never opened, so that a link or a pipe
// with such a name leads nowhere.
//
// Any thread; not for real-time code (waits for the disk).
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "common/error/error.h"

namespace palpate {

enum class IfThere { kReplace, kRefuse };
// kNo: for what another program reads at once and removes; the disk is not waited for.
enum class Durable { kYes, kNo };
// kRefused: of a path that was judged and holds no links. Somebody may since have put a link into
// its folder's name; the file is not written then.
enum class Links { kFollowed, kRefused };

// Of a file that cannot be written, by the system's error number: kNotFound (no such folder),
// kInvalidArgument (it is a folder), kPermissionDenied, kDiskFull, else kUnavailable.
Error CannotWrite(const std::filesystem::path& path, int error_number);

class NewFile {
 public:
  // Makes the file beside `path`. `mode`: less the process's umask. Throws Error: CannotWrite's;
  // kConflict where `path` is there and not to be replaced; kPermissionDenied for a link.
  explicit NewFile(std::filesystem::path path, IfThere if_there = IfThere::kReplace,
                   mode_t mode = 0666, Links links = Links::kFollowed);
  // Removes the file unless it has its name.
  ~NewFile();
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  // For what writes by itself, and its owner and mode.
  const std::filesystem::path& partial() const { return partial_; }
  int descriptor() const { return descriptor_; }
  bool has_name() const { return has_name_; }

  // All of the bytes. Throws CannotWrite; some of them may be there then.
  void Write(std::string_view bytes);
  // Returns when the bytes are on the disk. Throws CannotWrite.
  void Sync();
  // Syncs the file, names it, and syncs its folder; only names it if not durable. Throws
  // CannotWrite, or kConflict where `path` has come to be meanwhile and is not to be replaced:
  // `path` is as it was then, unless the disk itself fails at the folder: has_name() tells.
  void TakeName(Durable durable = Durable::kYes);

 private:
  bool RenameTo(unsigned flags) const;
  void Rename();
  void ClaimAndRename();

  const std::filesystem::path path_;
  const IfThere if_there_;
  // All is done in this folder, whatever its name leads to by then.
  int directory_ = -1;
  std::string partial_name_;
  std::filesystem::path partial_;
  int descriptor_ = -1;
  bool has_name_ = false;
};

// The same for what writes by a path of its own: has `write` fill the partial file. `write` throws
// std::ios_base::failure where it cannot, or any Error. Throws that Error, or NewFile's.
void WriteWhole(const std::filesystem::path& path,
                const std::function<void(const std::filesystem::path& partial)>& write,
                IfThere if_there = IfThere::kReplace, Durable durable = Durable::kYes,
                Links links = Links::kFollowed);

// Makes a folder and those above it where they are missing; their names outlive a loss of power.
// Throws CannotWrite.
void MakeFolders(const std::filesystem::path& folder);

// Makes names in a folder outlive a loss of power, where the file system can do that. Throws
// CannotWrite.
void SyncFolder(const std::filesystem::path& folder);

}  // namespace palpate
