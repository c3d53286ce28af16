#include "common/files/new_file.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/random.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <ios>
#include <string>
#include <system_error>
#include <utility>

#include "common/files/own_files.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void RefuseToOverwrite(const fs::path& path) {
  throw Error(ErrorKind::kConflict, path.string() +
                                        " is there already: allow to overwrite it (--overwrite, "
                                        "overwrite=True), or name another one");
}

void CheckName(const fs::path& path, IfThere if_there) {
  std::error_code ignored;
  const fs::file_type type = fs::symlink_status(path, ignored).type();
  if (type == fs::file_type::not_found || type == fs::file_type::none) return;
  if (type == fs::file_type::directory) throw CannotWrite(path, EISDIR);
  if (type == fs::file_type::regular) {
    if (if_there == IfThere::kRefuse) RefuseToOverwrite(path);
    return;
  }
  throw Error(ErrorKind::kInvalidArgument,
              path.string() + " is a link, a device or a pipe, and is not replaced: name a file");
}

// Six letters that cannot be predicted.
std::string RandomLetters() {
  constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyz234567";
  std::array<unsigned char, 6> random{};
  if (getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) return "";
  std::string letters;
  for (const unsigned char byte : random) letters += kLetters[byte % kLetters.size()];
  return letters;
}

// Returns -1 for a folder that we may write to but not read, so that we cannot sync it.
int OpenFolder(const fs::path& folder, const fs::path& name) {
  const int directory = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory < 0 && errno != EACCES) throw CannotWrite(name, errno);
  return directory;
}

void SyncAndClose(int directory, const fs::path& folder) {
  const bool synced = fsync(directory) == 0 || errno == EINVAL;
  const int error_number = errno;
  close(directory);
  if (!synced) throw CannotWrite(folder, error_number);
}

// Makes the names in a folder survive a power failure, if the file system can do that. Throws
// CannotWrite.
void SyncFolder(const fs::path& folder) {
  const int directory = OpenFolder(folder, folder);
  if (directory >= 0) SyncAndClose(directory, folder);
}

}  // namespace

Error CannotWrite(const fs::path& path, int error_number) {
  const auto error = [&](ErrorKind kind, const std::string& what_to_do) {
    return Error(kind, "cannot write " + path.string() + ": " +
                           std::generic_category().message(error_number) + what_to_do);
  };
  switch (error_number) {
    case ENOENT:
    case ENOTDIR:
      return error(ErrorKind::kNotFound, "; make the folder, or name another one");
    case EISDIR:
      return error(ErrorKind::kInvalidArgument, "; name a file");
    case EACCES:
    case EPERM:
    case EROFS:
      return error(ErrorKind::kPermissionDenied, "; may this user write there?");
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
      return error(ErrorKind::kDiskFull, "; make space, or name another folder");
    case EMFILE:
    case ENFILE:
      return error(ErrorKind::kTooLarge,
                   "; close some, or raise the limit (LimitNOFILE, ulimit -n)");
    default:
      return error(ErrorKind::kUnavailable, "; name another folder");
  }
}

NewFile::NewFile(fs::path path, IfThere if_there, mode_t mode, Links links)
    : path_(std::move(path)), if_there_(if_there) {
  CheckName(path_, if_there_);
  const fs::path folder = fs::absolute(path_).parent_path();
  directory_ = links == Links::kRefused ? OpenPlain(folder, O_PATH | O_DIRECTORY)
                                        : open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (directory_ < 0 && errno == ELOOP) {
    throw Error(ErrorKind::kPermissionDenied,
                path_.string() + ": a link has come into its folder's name; try again");
  }
  if (directory_ < 0) throw CannotWrite(path_, errno);
  descriptor_ = openat(directory_, ".", O_TMPFILE | O_RDWR | O_CLOEXEC, mode);
  if (descriptor_ >= 0) return;
  // The file system may make no files without a name.
  const bool is_made = GivePartialName([&](const char* name) {
    descriptor_ = openat(directory_, name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, mode);
    return descriptor_ >= 0;
  });
  if (is_made) return;
  const int error_number = errno;
  close(directory_);
  throw CannotWrite(path_, error_number);
}

NewFile::~NewFile() {
  close(descriptor_);
  if (!has_name_ && !partial_name_.empty()) unlinkat(directory_, partial_name_.c_str(), 0);
  close(directory_);
}

// `make`: tries the name. Returns false with errno if that fails.
bool NewFile::GivePartialName(const std::function<bool(const char* name)>& make) {
  std::string name;
  do {
    name = path_.filename().string() + "." + RandomLetters() + ".partial";
    if (make(name.c_str())) {
      partial_name_ = name;
      return true;
    }
  } while (errno == EEXIST);
  return false;
}

void NewFile::Write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(descriptor_, bytes.data(), bytes.size());
    if (written >= 0) {
      bytes.remove_prefix(static_cast<std::size_t>(written));
    } else if (errno != EINTR) {
      throw CannotWrite(path_, errno);
    }
  }
}

void NewFile::Sync() {
  if (fdatasync(descriptor_) != 0) throw CannotWrite(path_, errno);
}

void NewFile::TakeName(Durable durable) {
  if (durable == Durable::kYes) Sync();
  if (partial_name_.empty()) {
    const bool is_named = GivePartialName([&](const char* name) {
      return linkat(AT_FDCWD, ByDescriptor(descriptor_).c_str(), directory_, name,
                    AT_SYMLINK_FOLLOW) == 0;
    });
    if (!is_named) throw CannotWrite(path_, errno);
    // Again, and fast: btrfs keeps nothing of a file that has no name.
    if (durable == Durable::kYes) Sync();
  }
  const fs::path folder = fs::absolute(path_).parent_path();
  // Open the folder before the rename: if this fails, nothing has changed yet.
  const int directory =
      durable == Durable::kYes ? OpenFolder(ByDescriptor(directory_), folder) : -1;
  try {
    Rename();
  } catch (const Error&) {
    if (directory >= 0) close(directory);
    throw;
  }
  has_name_ = true;
  if (directory >= 0) SyncAndClose(directory, folder);
}

bool NewFile::RenameTo(unsigned flags) const {
  const std::string name = path_.filename();
  return renameat2(directory_, partial_name_.c_str(), directory_, name.c_str(), flags) == 0;
}

void NewFile::Rename() {
  if (if_there_ == IfThere::kReplace) {
    if (!RenameTo(0)) throw CannotWrite(path_, errno);
  } else if (!RenameTo(RENAME_NOREPLACE)) {
    if (errno == EEXIST) RefuseToOverwrite(path_);
    if (errno != EINVAL) throw CannotWrite(path_, errno);
    ClaimAndRename();
  }
}

// For file systems (NFS) that cannot rename without replacing.
void NewFile::ClaimAndRename() {
  const std::string name = path_.filename();
  const int claim = openat(directory_, name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (claim < 0 && errno == EEXIST) RefuseToOverwrite(path_);
  if (claim < 0) throw CannotWrite(path_, errno);
  close(claim);
  if (RenameTo(0)) return;
  const int error_number = errno;
  unlinkat(directory_, name.c_str(), 0);
  throw CannotWrite(path_, error_number);
}

void WriteWhole(const fs::path& path, const std::function<void(const fs::path& partial)>& write,
                IfThere if_there, Durable durable, Links links) {
  NewFile file(path, if_there, 0666, links);
  errno = 0;
  try {
    write(ByDescriptor(file.descriptor()));
  } catch (const std::ios_base::failure&) {
    // Streams do not report a reason, but errno of the failed call is still set.
    throw CannotWrite(path, errno != 0 ? errno : EIO);
  } catch (const fs::filesystem_error& error) {
    throw CannotWrite(path, error.code().value());
  }
  file.TakeName(durable);
}

void CheckNewFile(const fs::path& path, IfThere if_there) { const NewFile file(path, if_there); }

void MakeFolders(const fs::path& folder) {
  std::error_code error;
  if (folder.empty() || fs::is_directory(folder, error)) return;
  const fs::path above = fs::absolute(folder).parent_path();
  MakeFolders(above);
  fs::create_directory(folder, error);
  if (error) throw CannotWrite(folder, error.value());
  SyncFolder(above);
}

}  // namespace palpate
