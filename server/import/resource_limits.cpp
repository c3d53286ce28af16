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
constexpr rlim_t kMostThreads = 256;  // more than there are now

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
// The stacks of TBB's threads, and what malloc keeps for each of them.
constexpr std::int64_t kPerThread = std::int64_t{16} << 20;

std::int64_t PrivateMemoryNow() {
  std::int64_t pages[6] = {};  // size, resident, shared, text, lib, data
  std::ifstream file("/proc/self/statm");
  for (std::int64_t& number : pages) file >> number;
  return pages[5] * sysconf(_SC_PAGESIZE);
}
#endif

// The kernel counts those of the account, so that all of the machine are at least as many.
rlim_t ThreadsNow() {
  std::string load[3];
  rlim_t running = 0, threads = 0;
  char slash = 0;
  std::ifstream("/proc/loadavg") >> load[0] >> load[1] >> load[2] >> running >> slash >> threads;
  return threads;
}

}  // namespace

void LimitResources(std::int64_t max_memory_bytes, std::int64_t max_seconds) {
  const auto threads = static_cast<std::int64_t>(std::max(std::thread::hardware_concurrency(), 1u));
  Limit(RLIMIT_CORE, 0, "core dumps");
  Limit(RLIMIT_NOFILE, kOpenFiles, "open files");
  // TBB has a thread for each processor.
  Limit(RLIMIT_NPROC, ThreadsNow() + kMostThreads + 2 * static_cast<rlim_t>(threads), "threads");
  Limit(RLIMIT_CPU, static_cast<rlim_t>(max_seconds * threads), "processor time");
  // A written tree or volume is no larger than the memory that held it.
  signal(SIGXFSZ, SIG_IGN);
  Limit(RLIMIT_FSIZE, static_cast<rlim_t>(max_memory_bytes), "file size");
#ifndef PALPATE_SANITIZED
  // Not the address space: malloc reserves much of it for each thread, so that its limit would have
  // to be hundreds of MiB larger than what may be used.
  Limit(RLIMIT_DATA,
        static_cast<rlim_t>(PrivateMemoryNow() + threads * kPerThread + max_memory_bytes),
        "memory");
#endif
  GiveWay();
}

void GiveWay() {
  setpriority(PRIO_PROCESS, 0, kNiceness);
  std::ofstream("/proc/self/oom_score_adj") << 1000;
}

}  // namespace palpate
