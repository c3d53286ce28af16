#include "common/files/plain_path.h"

#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdint>
#include <string>
#include <system_error>

namespace palpate {

namespace fs = std::filesystem;

int OpenPlain(const fs::path& path, int flags) {
  const open_how how{.flags = static_cast<std::uint64_t>(flags) | O_CLOEXEC,
                     .mode = 0,
                     .resolve = RESOLVE_NO_SYMLINKS};
  return static_cast<int>(syscall(SYS_openat2, AT_FDCWD, path.c_str(), &how, sizeof how));
}

fs::path ByDescriptor(int descriptor) { return "/proc/self/fd/" + std::to_string(descriptor); }

fs::path RealPath(int descriptor) {
  std::error_code error;
  return fs::read_symlink(ByDescriptor(descriptor), error);
}

}  // namespace palpate
