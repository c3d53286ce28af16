#include "server/import/confinement.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>

#include "common/error/error.h"
#include "common/files/plain_path.h"
#include "server/import/library_threads.h"
#include "server/import/system_calls.h"

namespace palpate {
namespace {

// Missing in Debian 12's headers.
constexpr std::uint64_t kTruncate = 1ULL << 14;

constexpr std::uint64_t kReadFile = LANDLOCK_ACCESS_FS_READ_FILE;
constexpr std::uint64_t kRead = kReadFile | LANDLOCK_ACCESS_FS_READ_DIR;

// All rights that the kernel's version of Landlock knows. The first version has 13 rights.
std::uint64_t Handled(long version) {
  std::uint64_t rights = (1ULL << 13) - 1;
  if (version >= 2) rights |= LANDLOCK_ACCESS_FS_REFER;
  if (version >= 3) rights |= kTruncate;
  return rights;
}

[[noreturn]] void Fail(const char* what) {
  throw Error(ErrorKind::kInternal,
              std::string("cannot confine the importer (") + what + "): " + std::strerror(errno));
}

// Closes `place`. If `place` is -1, allows nothing.
void Allow(int rules, int place, std::uint64_t rights) {
  if (place < 0) return;
  struct stat status {};
  if (fstat(place, &status) == 0 && !S_ISDIR(status.st_mode)) rights &= kReadFile;
  landlock_path_beneath_attr rule{.allowed_access = rights, .parent_fd = place};
  const bool added =
      syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) == 0;
  close(place);
  if (!added) Fail("landlock_add_rule");
}

#ifdef PALPATE_SANITIZED
// At the program's end, the leak checker examines the process itself, starts a program that finds
// the names of functions, and reads its list of suppressions.
void AllowLeakChecker(int rules, std::uint64_t handled) {
  Allow(rules, open("/usr", O_PATH | O_CLOEXEC), (kRead | LANDLOCK_ACCESS_FS_EXECUTE) & handled);
  Allow(rules, open("/proc", O_PATH | O_CLOEXEC), kRead & handled);
  const char* options = std::getenv("LSAN_OPTIONS");
  const std::string_view text = options ? options : "";
  constexpr std::string_view kKey = "suppressions=";
  const std::size_t key = text.find(kKey);
  if (key == text.npos) return;
  const std::string_view file = text.substr(key + kKey.size());
  Allow(rules, open(std::string(file.substr(0, file.find(':'))).c_str(), O_PATH | O_CLOEXEC),
        kRead & handled);
}
#endif

void ConfineFiles(const std::vector<std::filesystem::path>& readable) {
  const long version =
      syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  if (version < 1) return;
  const std::uint64_t handled = Handled(version);
  const landlock_ruleset_attr all{.handled_access_fs = handled};
  const int rules =
      static_cast<int>(syscall(SYS_landlock_create_ruleset, &all, sizeof all.handled_access_fs, 0));
  if (rules < 0) Fail("landlock_create_ruleset");
  for (const char* system : {"/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime"}) {
    Allow(rules, open(system, O_PATH | O_CLOEXEC), kRead & handled);
  }
#ifdef PALPATE_SANITIZED
  AllowLeakChecker(rules, handled);
#endif
  if (readable.empty()) Allow(rules, open("/", O_PATH | O_CLOEXEC), kRead & handled);
  for (const std::filesystem::path& path : readable) {
    Allow(rules, OpenPlain(path, O_PATH), kRead & handled);
  }
  if (syscall(SYS_landlock_restrict_self, rules, 0) != 0) Fail("landlock_restrict_self");
  close(rules);
}

}  // namespace

void Confine(const std::vector<std::filesystem::path>& readable) {
  EndLibraryThreads();
#ifndef PALPATE_SANITIZED  // ThreadSanitizer has a thread of its own
  if (!IsOnlyThread()) {
    throw Error(ErrorKind::kInternal, "cannot confine the importer (other threads run already)");
  }
#endif
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) Fail("no_new_privs");
  ConfineFiles(readable);
  ConfineSystemCalls();
}

}  // namespace palpate
