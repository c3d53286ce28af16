#include "server/door/open_files.h"

#include <sys/resource.h>

#include <algorithm>

namespace palpate {
namespace {

// Files that the daemon opens besides connections: for gRPC's and the device's threads, volumes,
// recordings, importers. About 60 were seen.
constexpr int kOwnFiles = 256;

}  // namespace

int RaiseOpenFileLimit() {
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
  getrlimit(RLIMIT_NOFILE, &limit);
  return static_cast<int>(std::min<rlim_t>(limit.rlim_cur, 1 << 20));
}

int FirstRefusedFile(int open_file_limit, int most_connections) {
  const int reserve = std::min(kOwnFiles, open_file_limit / 4);
  return std::min(open_file_limit - reserve, kOwnFiles + most_connections);
}

int FirstSecondFile(int open_file_limit, int most_connections) {
  const int first = FirstRefusedFile(open_file_limit, most_connections) + kOwnFiles;
  return first <= open_file_limit - kOwnFiles - most_connections ? first : 0;
}

}  // namespace palpate
