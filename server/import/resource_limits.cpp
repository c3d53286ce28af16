#include "server/import/resource_limits.h"

#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>
#include <thread>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr int kNiceness = 5;
constexpr rlim_t kOpenFiles = 256;

void Limit(__rlimit_resource resource, rlim_t wanted, const char* what) {
  rlimit limit{};
  getrlimit(resource, &limit);
  limit.rlim_cur = std::min(wanted, limit.rlim_max);
  limit.rlim_max = limit.rlim_cur;
  if (setrlimit(resource, &limit) != 0) {
    throw Error(ErrorKind::kInternal,
                std::string("cannot limit the ") + what + ": " + std::strerror(errno));
  }
}

#ifndef PALPATE_SANITIZED
// Stacks of TBB's threads and malloc's arenas reserve much address space and use little of it.
constexpr std::int64_t kReservedPerThread = std::int64_t{80} << 20;
constexpr std::int64_t kReserved = std::int64_t{256} << 20;

std::int64_t AddressSpaceNow() {
  std::int64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * sysconf(_SC_PAGESIZE);
}
#endif

}  // namespace

void LimitResources(std::int64_t max_memory_bytes, std::int64_t max_seconds) {
  const auto threads = static_cast<std::int64_t>(std::max(std::thread::hardware_concurrency(), 1u));
  Limit(RLIMIT_CORE, 0, "core dumps");
  Limit(RLIMIT_NOFILE, kOpenFiles, "open files");
  Limit(RLIMIT_CPU, static_cast<rlim_t>(max_seconds * threads), "processor time");
  // A written tree or volume is no larger than the memory that held it.
  signal(SIGXFSZ, SIG_IGN);
  Limit(RLIMIT_FSIZE, static_cast<rlim_t>(max_memory_bytes), "file size");
#ifndef PALPATE_SANITIZED
  Limit(RLIMIT_AS,
        static_cast<rlim_t>(AddressSpaceNow() + kReserved + threads * kReservedPerThread +
                            max_memory_bytes),
        "address space");
#endif
  setpriority(PRIO_PROCESS, 0, kNiceness);
}

}  // namespace palpate
