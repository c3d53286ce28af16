#include "server/state/private_folder.h"

#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>

#include "common/error/error.h"

namespace palpate {

std::filesystem::path TemporaryFolder() {
  const char* folder = std::getenv("TMPDIR");
  return folder && *folder ? folder : "/tmp";
}

PrivateFolder::PrivateFolder(const std::filesystem::path& parent, std::string_view prefix) {
  std::string name = parent / (std::string(prefix) + std::to_string(getpid()) + "-XXXXXX");
  if (!mkdtemp(name.data())) {
    throw Error(ErrorKind::kUnavailable, "cannot make a folder " + name + ": " +
                                             std::strerror(errno) +
                                             "; is there space, and may this user write there?");
  }
  path_ = name;
}

PrivateFolder::~PrivateFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

void RemoveAbandonedFolders(const std::filesystem::path& parent, std::string_view prefix) {
  std::error_code error;
  std::filesystem::directory_iterator entry(parent, error);
  for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename();
    if (!name.starts_with(prefix)) continue;
    pid_t process = 0;
    std::from_chars(name.data() + prefix.size(), name.data() + name.size(), process);
    if (process <= 0 || kill(process, 0) == 0 || errno != ESRCH) continue;
    std::error_code ignored;
    std::filesystem::remove_all(entry->path(), ignored);
  }
}

}  // namespace palpate
