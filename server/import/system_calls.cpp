#include "server/import/system_calls.h"

#ifndef PALPATE_SANITIZED

#include <asm/ioctls.h>
#include <fcntl.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <string>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

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

}  // namespace

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

}  // namespace palpate

#else

namespace palpate {

void ConfineSystemCalls() {}

}  // namespace palpate

#endif
