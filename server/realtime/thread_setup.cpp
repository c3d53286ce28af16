#include "server/realtime/thread_setup.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <system_error>

namespace palpate {
namespace {

constexpr char kThreadName[] = "palpate-rt";
constexpr std::size_t kStackBytes = 256 * 1024;
constexpr std::size_t kSmallestPageBytes = 4096;

// Guards is_locked.
std::mutex lock_mutex;
bool is_locked = false;

// Pages in memory stay there. Other pages are locked when they are first touched.
bool LockOnFault() { return mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0; }

// strerror is not thread-safe; this function is.
std::string Describe(int error_number) { return std::generic_category().message(error_number); }

// True if this process may lock more than `limit_bytes`. Only a try can tell: inside a container,
// the process's capabilities do not show whether it is exempt (CAP_IPC_LOCK in the initial user
// namespace). MLOCK_ONFAULT uses no memory.
bool MayLockMoreThan(rlim_t limit_bytes) {
  const std::size_t size_bytes = limit_bytes + kSmallestPageBytes;
  void* probe = mmap(nullptr, size_bytes, PROT_READ | PROT_WRITE,
                     MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (probe == MAP_FAILED) return false;
  const bool locked = mlock2(probe, size_bytes, MLOCK_ONFAULT) == 0;
  munmap(probe, size_bytes);
  return locked;
}

// Touches the stack that the thread will use, so that no tick has a page fault there.
[[gnu::noinline]] void PrefaultStack() {
  char stack[kStackBytes];
  volatile char* const touched = stack;  // without volatile the writes would be optimised away
  for (std::size_t i = 0; i < kStackBytes; i += kSmallestPageBytes) touched[i] = 0;
}

void SetPriority(int priority, RealtimeGrant& grant) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  // Reset on fork: a child process must not start with this thread's priority.
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0) {
    grant.fifo = true;
    return;
  }
  const int error_number = errno;
  const std::string advice =
      error_number == EINVAL
          ? "give a priority from 1 to 99"
          : "run as a user with LimitRTPRIO (ulimit -r) of at least " + std::to_string(priority) +
                ", and check kernel.sched_rt_runtime_us and the container's limits";
  grant.warnings.push_back("no real-time scheduling (SCHED_FIFO " + std::to_string(priority) +
                           " refused: " + Describe(error_number) + "): " + advice +
                           "; using ordinary scheduling: ticks will be late at times");
}

void SetCpu(int cpu, RealtimeGrant& grant) {
  int error_number = EINVAL;
  if (cpu < CPU_SETSIZE) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(cpu, &cpus);
    error_number = pthread_setaffinity_np(pthread_self(), sizeof cpus, &cpus);
  }
  if (error_number == 0) return;
  grant.warnings.push_back("the real-time thread is not bound to CPU " + std::to_string(cpu) +
                           " (" + Describe(error_number) +
                           "): choose one that this process may use (taskset -p, AllowedCPUs); "
                           "the thread runs on any CPU");
}

}  // namespace

bool LockProcessMemory(std::vector<std::string>& warnings) noexcept {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  std::string reason;
  if (limit.rlim_cur != RLIM_INFINITY && !MayLockMoreThan(limit.rlim_cur)) {
    reason = "only " + std::to_string(limit.rlim_cur / 1024) +
             " KiB may be locked, and later allocations would fail at that limit";
  } else {
    const std::lock_guard lock(lock_mutex);
    // The first call brings everything that is mapped now into memory, including programs and
    // libraries.
    is_locked = mlockall(MCL_CURRENT) == 0 && LockOnFault();
    if (is_locked) return true;
    reason = "mlockall refused: " + Describe(errno);
  }
  warnings.push_back("memory is not locked (" + reason +
                     "): set LimitMEMLOCK=infinity (ulimit -l unlimited) or grant CAP_IPC_LOCK; "
                     "until then ticks will be late when memory has to be paged in");
  return false;
}

void SetupRealtimeThread(const RealtimeOptions& options, RealtimeGrant& grant) noexcept {
  if (pthread_setname_np(pthread_self(), kThreadName) != 0) {
    grant.warnings.push_back(std::string("the real-time thread could not be named ") + kThreadName +
                             "; the thread keeps the name of the process");
  }
  if (options.cpu >= 0) SetCpu(options.cpu, grant);
  if (options.lock_memory && !grant.memory_locked) {
    grant.memory_locked = LockProcessMemory(grant.warnings);
  }
  PrefaultStack();
  // Last, so that the preparations above do not run at real-time priority.
  SetPriority(options.priority, grant);
}

OrdinaryScheduling::OrdinaryScheduling() noexcept : policy_(sched_getscheduler(0)) {
  sched_param parameters{};
  sched_getparam(0, &parameters);
  priority_ = parameters.sched_priority;
  parameters.sched_priority = 0;
  // The flag stays: only root may take it away.
  sched_setscheduler(0, SCHED_OTHER | (policy_ & SCHED_RESET_ON_FORK), &parameters);
}

OrdinaryScheduling::~OrdinaryScheduling() {
  sched_param parameters{};
  parameters.sched_priority = priority_;
  sched_setscheduler(0, policy_, &parameters);
}

void SetThreadNice(int nice) noexcept {
  // Linux keeps the value for each thread.
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), nice);
}

int ThreadNice() noexcept { return getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())); }

long ThreadPageFaults() noexcept {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_minflt + usage.ru_majflt;
}

}  // namespace palpate
