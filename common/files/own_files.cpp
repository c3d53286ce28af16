#include "common/files/own_files.h"

#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <system_error>
#include <utility>

namespace palpate {
namespace {

namespace fs = std::filesystem;

// Returns the present path of an open file, or "" if it is not known.
fs::path RealPath(int descriptor) {
  std::error_code error;
  return fs::read_symlink(ByDescriptor(descriptor), error);
}

}  // namespace

int OpenPlain(const fs::path& path, int flags) {
  const open_how how{.flags = static_cast<std::uint64_t>(flags) | O_CLOEXEC,
                     .mode = 0,
                     .resolve = RESOLVE_NO_SYMLINKS};
  return static_cast<int>(syscall(SYS_openat2, AT_FDCWD, path.c_str(), &how, sizeof how));
}

fs::path ByDescriptor(int descriptor) { return "/proc/self/fd/" + std::to_string(descriptor); }

namespace {

// Compares by components: /data does not contain /database.
bool IsWithin(const fs::path& folder, const fs::path& path) {
  return std::mismatch(folder.begin(), folder.end(), path.begin(), path.end()).first ==
         folder.end();
}

bool IsSame(const fs::path& path, const struct stat& file) {
  struct stat own {};
  return stat(path.c_str(), &own) == 0 && own.st_dev == file.st_dev && own.st_ino == file.st_ino;
}

// True if `file` is `own`, or lies in the folder `own`.
bool HoldsSame(const fs::path& own, const struct stat& file) {
  if (IsSame(own, file)) return true;
  std::error_code error;
  fs::recursive_directory_iterator entry(own, fs::directory_options::skip_permission_denied, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    if (IsSame(entry->path(), file)) return true;
  }
  return false;
}

}  // namespace

OwnFiles::OwnFiles(std::vector<fs::path> paths) : paths_(std::move(paths)) {}

bool OwnFiles::Hold(const fs::path& file) const {
  std::error_code error;
  const fs::path real = fs::weakly_canonical(file, error);
  if (error) return false;  // this name cannot be opened
  struct stat status {};
  if (stat(real.c_str(), &status) != 0) status = {};
  return HoldReal(real, status);
}

bool OwnFiles::HoldOpen(int descriptor) const {
  struct stat status {};
  return fstat(descriptor, &status) != 0 || HoldReal(RealPath(descriptor), status);
}

bool OwnFiles::HoldReal(const fs::path& real, const struct stat& status) const {
  for (const char* kernel : {"/proc", "/sys"}) {
    if (IsWithin(kernel, real)) return true;
  }
  const bool is_file = S_ISREG(status.st_mode);
  return std::ranges::any_of(paths_, [&](const fs::path& own) {
    std::error_code ignored;
    return IsWithin(fs::weakly_canonical(own, ignored), real) ||
           (is_file && HoldsSame(own, status));
  });
}

}  // namespace palpate
