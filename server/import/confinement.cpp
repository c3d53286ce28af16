#include "server/import/confinement.h"

#include <asm/ioctls.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <seccomp.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "common/files/own_files.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// Landlock would not confine threads that libraries start before main(): it confines only the
// calling thread and the threads that this thread starts. Ends the known ones: OpenVDB's log
// library, log4cplus, starts four for asynchronous logging, which nothing here uses.
void EndLibraryThreads() {
  // Looks the function up by name: log4cplus comes with OpenVDB only if OpenVDB was built with it,
  // and we do not link it.
  using Function = void (*)();
  const auto end =
      reinterpret_cast<Function>(dlsym(RTLD_DEFAULT, "_ZN9log4cplus18shutdownThreadPoolEv"));
  if (end) end();
}

#ifndef PALPATE_SANITIZED

std::ptrdiff_t CountThreads() {
  std::error_code error;
  const fs::directory_iterator threads("/proc/self/task", error);
  return error ? 1 : std::distance(begin(threads), end(threads));
}

// True if this thread is the only one. Waits up to a second for threads that are about to end. Also
// true without /proc.
bool IsOnlyThread() {
  constexpr int kTries = 1000;
  for (int k = 0; k < kTries; ++k) {
    if (CountThreads() == 1) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

// Names that an architecture lacks are skipped there. 32-bit architectures have extra names for
// calls with 64-bit numbers; newer architectures have only openat() and no open().

constexpr const char* kFiles[] = {"_llseek",    "access",       "arm_fadvise64_64",
                                  "close",      "dup",          "dup2",
                                  "dup3",       "faccessat",    "faccessat2",
                                  "fadvise64",  "fadvise64_64", "fallocate",
                                  "fdatasync",  "fstat",        "fstat64",
                                  "fstatat64",  "fstatfs",      "fstatfs64",
                                  "fsync",      "ftruncate",    "ftruncate64",
                                  "getcwd",     "getdents",     "getdents64",
                                  "lseek",      "lstat",        "lstat64",
                                  "newfstatat", "pread64",      "preadv",
                                  "pwrite64",   "pwritev",      "read",
                                  "readahead",  "readlink",     "readlinkat",
                                  "readv",      "stat",         "stat64",
                                  "statfs",     "statfs64",     "statx",
                                  "write",      "writev"};

constexpr const char* kMemoryAndThreads[] = {
    "brk", "exit", "exit_group", "futex", "futex_time64", "mremap", "msync", "munmap",
    // A new thread registers itself with these calls.
    "rseq", "set_robust_list", "set_tid_address", "sched_getaffinity", "sched_yield"};

constexpr const char* kSignalsAndClocks[] = {
    "clock_getres", "clock_getres_time64", "clock_gettime", "clock_gettime64", "clock_nanosleep",
    "clock_nanosleep_time64", "gettimeofday", "nanosleep",
    // Continues a sleep that a signal interrupted.
    "restart_syscall", "rt_sigaction", "rt_sigprocmask", "rt_sigreturn", "sigaltstack", "sigreturn",
    "time", "times"};

// Facts about the process itself and the machine. TBB counts the processors. abort() asks for the
// process and the thread.
constexpr const char* kFacts[] = {"getcpu",     "getegid",  "getegid32", "geteuid",   "geteuid32",
                                  "getgid",     "getgid32", "getpid",    "getrandom", "getrlimit",
                                  "getrusage",  "gettid",   "getuid",    "getuid32",  "sysinfo",
                                  "ugetrlimit", "uname"};

// The flags of these calls lie in memory, which the kernel's filters cannot read. The calls appear
// not to exist. glibc then falls back to clone().
constexpr const char* kNotThere[] = {"clone3", "openat2"};

// Calls that no reader makes, whatever the file. Each is a sign that the process was taken over.
constexpr const char* kAttacks[] = {
    // Other programs and processes.
    "execve", "execveat", "fork", "kcmp", "kill", "pidfd_getfd", "pidfd_open", "pidfd_send_signal",
    "process_madvise", "process_mrelease", "process_vm_readv", "process_vm_writev", "ptrace",
    "rt_sigqueueinfo", "rt_tgsigqueueinfo", "tkill", "vfork",
    // The network.
    "accept", "accept4", "bind", "connect", "listen", "recvfrom", "recvmmsg", "recvmsg", "sendmmsg",
    "sendmsg", "sendto", "socket", "socketcall", "socketpair",
    // Privileges, file systems and the machine.
    "capset", "chroot", "delete_module", "finit_module", "fsconfig", "fsmount", "fsopen", "fspick",
    "init_module", "ioperm", "iopl", "kexec_file_load", "kexec_load", "mount", "mount_setattr",
    "move_mount", "open_by_handle_at", "name_to_handle_at", "open_tree", "personality",
    "pivot_root", "reboot", "setns", "swapoff", "swapon", "umount", "umount2", "unshare",
    // Kernel interfaces in which faults are often found.
    "add_key", "bpf", "io_uring_enter", "io_uring_register", "io_uring_setup", "keyctl",
    "memfd_create", "memfd_secret", "modify_ldt", "perf_event_open", "request_key", "userfaultfd"};

constexpr std::uint32_t kRefuse = SCMP_ACT_ERRNO(EPERM);

// Opening to read means: an access mode of 0, and the file is neither made nor emptied.
constexpr unsigned kOpenToWrite = O_ACCMODE | O_CREAT | O_TRUNC;

constexpr unsigned kThread = CLONE_VM | CLONE_SIGHAND | CLONE_THREAD;
constexpr unsigned kNewSpaces = CLONE_NEWCGROUP | CLONE_NEWIPC | CLONE_NEWNET | CLONE_NEWNS |
                                CLONE_NEWPID | CLONE_NEWUSER | CLONE_NEWUTS;
#ifdef __s390__
constexpr unsigned kCloneFlags = 1;  // the stack comes first
#else
constexpr unsigned kCloneFlags = 0;
#endif

// Advice from this number on is about the machine's memory: MADV_HWPOISON and MADV_SOFT_OFFLINE.
constexpr int kFirstMachineAdvice = 100;

[[noreturn]] void Fail(const std::string& what, int error_number) {
  throw Error(ErrorKind::kInternal,
              "cannot confine the importer (" + what + "): " + std::strerror(error_number));
}

bool KernelHasIt() {
  const std::uint32_t action = SECCOMP_RET_KILL_PROCESS;
  if (syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0) return true;
  if (errno == ENOSYS || errno == EINVAL || errno == EOPNOTSUPP) return false;
  Fail("seccomp", errno);
}

class Filter {
 public:
  Filter() : context_(seccomp_init(kRefuse), seccomp_release) {
    if (!context_) Fail("seccomp_init", ENOMEM);
    Set(SCMP_FLTATR_CTL_TSYNC, 1);
    // Calls by the numbers of another architecture, for example 32-bit ones.
    Set(SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS);
  }

  template <typename Names>
  void Add(std::uint32_t action, const Names& names) {
    for (const char* name : names) Add(action, name, {});
  }

  // Adds a rule that applies if all conditions of `when` hold.
  void Add(std::uint32_t action, const char* name, const std::vector<scmp_arg_cmp>& when) {
    const int number = seccomp_syscall_resolve_name(name);
    if (number == __NR_SCMP_ERROR) return;  // the library does not know it yet
    const int failure = seccomp_rule_add_array(context_.get(), action, number,
                                               static_cast<unsigned>(when.size()), when.data());
    if (failure != 0) Fail(name, -failure);
  }

  void Load() {
    const int failure = seccomp_load(context_.get());
    if (failure != 0) Fail("seccomp_load", -failure);
  }

 private:
  void Set(scmp_filter_attr attribute, std::uint32_t value) {
    const int failure = seccomp_attr_set(context_.get(), attribute, value);
    if (failure != 0) Fail("seccomp_attr_set", -failure);
  }

  std::unique_ptr<void, decltype(&seccomp_release)> context_;
};

scmp_arg_cmp Is(unsigned argument, std::uint64_t value) {
  return {argument, SCMP_CMP_EQ, value, 0};
}

scmp_arg_cmp HasNone(unsigned argument, std::uint64_t bits) {
  return {argument, SCMP_CMP_MASKED_EQ, bits, 0};
}

void AllowFiles(Filter* filter) {
  filter->Add(SCMP_ACT_ALLOW, kFiles);
  filter->Add(SCMP_ACT_ALLOW, "open", {HasNone(1, kOpenToWrite)});
  filter->Add(SCMP_ACT_ALLOW, "openat", {HasNone(2, kOpenToWrite)});
  // Without the commands that send signals to any process (F_SETOWN, F_SETFL with O_ASYNC).
  for (const int command :
       {F_DUPFD, F_DUPFD_CLOEXEC, F_GETFD, F_SETFD, F_GETFL, F_ADD_SEALS, F_GET_SEALS}) {
    for (const char* name : {"fcntl", "fcntl64"}) {
      filter->Add(SCMP_ACT_ALLOW, name, {Is(1, static_cast<unsigned>(command))});
    }
  }
  // The standard library asks whether a descriptor is a terminal, and how much it can read.
  for (const unsigned request : {TCGETS, FIONREAD}) {
    filter->Add(SCMP_ACT_ALLOW, "ioctl", {Is(1, request)});
  }
}

// Writable memory never becomes executable. A library that is loaded later is therefore refused,
// too: TBB then runs without its allocator, libtbbmalloc. Memory without a file is private and no
// stack: RLIMIT_DATA counts neither shared memory nor a mapping that grows down.
void AllowMapping(Filter* filter, const char* name) {
  filter->Add(SCMP_ACT_ALLOW, name, {HasNone(2, PROT_EXEC), HasNone(3, MAP_ANONYMOUS)});
  filter->Add(
      SCMP_ACT_ALLOW, name,
      {HasNone(2, PROT_EXEC), {3, SCMP_CMP_MASKED_EQ, MAP_TYPE | MAP_GROWSDOWN, MAP_PRIVATE}});
}

void AllowMemory(Filter* filter) {
#ifdef __s390__
  // The arguments of this call lie in memory, which the kernel's filters cannot read.
  filter->Add(SCMP_ACT_ALLOW, "mmap", {});
#elif !defined(__i386__)  // the same there, but glibc uses mmap2
  AllowMapping(filter, "mmap");
#endif
  AllowMapping(filter, "mmap2");
  filter->Add(SCMP_ACT_ALLOW, "mprotect", {HasNone(2, PROT_EXEC)});
  filter->Add(SCMP_ACT_ALLOW, "madvise", {{2, SCMP_CMP_LT, kFirstMachineAdvice, 0}});
}

void AllowThreads(Filter* filter) {
  filter->Add(SCMP_ACT_ALLOW, "clone",
              {{kCloneFlags, SCMP_CMP_MASKED_EQ, kThread | kNewSpaces, kThread}});
  filter->Add(SCMP_ACT_KILL_PROCESS, "clone", {HasNone(kCloneFlags, CLONE_THREAD)});
  filter->Add(SCMP_ACT_ALLOW, "prctl", {Is(0, PR_SET_NAME)});
  // abort() sends a signal to its own thread.
  const auto own = static_cast<std::uint64_t>(getpid());
  filter->Add(SCMP_ACT_ALLOW, "tgkill", {Is(0, own)});
  filter->Add(SCMP_ACT_KILL_PROCESS, "tgkill", {{0, SCMP_CMP_NE, own, 0}});
  // A process may read its own limits.
  filter->Add(SCMP_ACT_ALLOW, "prlimit64", {Is(0, 0), Is(2, 0)});
}

// Limits the system calls of the importer. If a hostile file takes over a library, that library can
// neither reach other processes and the network nor attack parts of the kernel that no reader
// needs.
//
// Errors: Error (kInternal) if the kernel has seccomp and refuses. A kernel without seccomp (before
// Linux 4.14) confines nothing here. Sanitizer builds confine nothing either, because the
// sanitizers' runtime forks, traces the process and opens pipes for its report.
//
// Confines all threads, also later ones, permanently. These calls remain:
// - reading files, and writing to descriptors that are already open for writing;
// - memory that holds no code, threads, locks, clocks and signals within the process.
// For calls that only an attacker makes, the kernel ends the process with SIGSYS. All other calls
// fail with EPERM. The lists above name both.
void ConfineSystemCalls() {
  if (!KernelHasIt()) return;
  Filter filter;
  AllowFiles(&filter);
  AllowMemory(&filter);
  AllowThreads(&filter);
  filter.Add(SCMP_ACT_ALLOW, kMemoryAndThreads);
  filter.Add(SCMP_ACT_ALLOW, kSignalsAndClocks);
  filter.Add(SCMP_ACT_ALLOW, kFacts);
  filter.Add(SCMP_ACT_ERRNO(ENOSYS), kNotThere);
  filter.Add(SCMP_ACT_KILL_PROCESS, kAttacks);
  filter.Load();
}

#else

void ConfineSystemCalls() {}

#endif

// Landlock.

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
