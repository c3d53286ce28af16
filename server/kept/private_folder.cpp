#include "server/kept/private_folder.h"

#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <string>
#include <system_error>

#include "common/files/new_file.h"

namespace palpate {

std::filesystem::path TemporaryFolder() {
  const char* folder = std::getenv("TMPDIR");
  return folder && *folder ? folder : "/tmp";
}

PrivateFolder::PrivateFolder(const std::filesystem::path& parent, std::string_view prefix) {
  std::string name = parent / (std::string(prefix) + std::to_string(getpid()) + "-XXXXXX");
  if (!mkdtemp(name.data())) {
    const Error error = CannotWrite(name, errno);
    // The folder is the daemon's own, not one that a client named.
    const bool is_missing = error.kind() == ErrorKind::kNotFound;
    throw Error(is_missing ? ErrorKind::kUnavailable : error.kind(), error.what());
  }
  path_ = name;
}

PrivateFolder::~PrivateFolder() {
  std::error_code error;
  std::filesystem::remove_all(path_, error);
  if (error) std::filesystem::remove(path_, error);  // an empty one goes without a descriptor
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
