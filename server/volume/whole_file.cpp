#include "server/volume/whole_file.h"

#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include <cerrno>
#include <ios>
#include <system_error>

#include "common/error/error.h"

namespace palpate {
namespace {

void TakeItsPlace(const std::filesystem::path& partial, const std::filesystem::path& path,
                  IfThere if_there) {
  if (if_there == IfThere::kRefuse) {
    if (renameat2(AT_FDCWD, partial.c_str(), AT_FDCWD, path.c_str(), RENAME_NOREPLACE) == 0) return;
    const int reason = errno;
    // Some file systems cannot: look first there.
    if (reason == EEXIST || (reason == EINVAL && std::filesystem::exists(path))) {
      throw Error(ErrorKind::kConflict, path.string() +
                                            " is there: allow to overwrite it, or "
                                            "name another one");
    }
    if (reason != EINVAL) {
      throw std::filesystem::filesystem_error("rename", path,
                                              std::error_code(reason, std::generic_category()));
    }
  }
  std::filesystem::rename(partial, path);
}

}  // namespace

void RefuseLink(const std::filesystem::path& partial) {
  std::error_code ignored;
  if (!std::filesystem::is_symlink(partial, ignored) ||
      std::filesystem::is_character_file(partial, ignored)) {
    return;
  }
  throw Error(
      ErrorKind::kPermissionDenied,
      partial.string() + " is a link to another file, which would be overwritten: remove it");
}

void WriteWhole(const std::filesystem::path& path,
                const std::function<void(const std::filesystem::path& partial)>& write,
                IfThere if_there) {
  const std::filesystem::path partial = path.string() + ".partial";
  RefuseLink(partial);
  try {
    write(partial);
    TakeItsPlace(partial, path, if_there);
  } catch (const std::ios_base::failure&) {
    std::remove(partial.c_str());
    throw Error(ErrorKind::kUnavailable, "cannot write " + path.string() +
                                             "; is there space, and may this user write there?");
  } catch (const std::filesystem::filesystem_error& error) {
    std::remove(partial.c_str());
    throw Error(ErrorKind::kUnavailable,
                "cannot write " + path.string() + ": " + error.code().message());
  } catch (...) {
    std::remove(partial.c_str());
    throw;
  }
}

void Sync(const std::filesystem::path& file) {
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  // Special files cannot be synced, nor need they be.
  const bool failed = descriptor < 0 || (fsync(descriptor) != 0 && errno != EINVAL);
  if (descriptor >= 0) close(descriptor);
  if (failed) throw std::ios_base::failure("fsync");
}

}  // namespace palpate
