// Attacks on the confinement of palpate-import; see confined_child.cpp.
#include <fcntl.h>
#include <linux/keyctl.h>
#include <sched.h>
#include <signal.h>
#include <sys/epoll.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>

#include "tests/integration/confined_child.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

long Call(long number, auto... arguments) { return syscall(number, arguments...); }

long EndChild(long pid) {
  if (pid == 0) _exit(0);
  return pid;
}

long RunTrue() {
  char name[] = "true";
  char* arguments[] = {name, nullptr};
  char* environment[] = {nullptr};
  return execve("/bin/true", arguments, environment);
}

long CopyMemory(long call) {
  char copy[sizeof bytes];
  iovec here{copy, sizeof copy};
  iovec there{bytes, sizeof bytes};
  return Call(call, parent, &here, 1, &there, 1, 0);
}

long Map(int protection, int flags, int file) {
  return mmap(nullptr, 4096, protection, flags, file, 0) == MAP_FAILED ? -1 : 0;
}

// What was written becomes code.
long MakeCode() {
  void* const page =
      mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (page == MAP_FAILED) return -1;
  std::memset(page, 0xc3, 4096);
  return mprotect(page, 4096, PROT_READ | PROT_EXEC);
}

long LimitParent() {
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  return Call(SYS_prlimit64, parent, RLIMIT_NOFILE, &limit, nullptr);
}

long PinParent() {
  cpu_set_t processors;
  CPU_ZERO(&processors);
  CPU_SET(0, &processors);
  return sched_setaffinity(parent, sizeof processors, &processors);
}

long KeepScheduling() {
  const sched_param parameters{};
  return sched_setscheduler(0, SCHED_OTHER, &parameters);
}

long LoseCapabilities() {
  // Of a version that there is not.
  std::uint32_t header[2] = {0, 0};
  std::uint32_t data[6] = {};
  return Call(SYS_capset, header, data);
}

long Clone3() {
  std::array<std::uint64_t, 8> arguments{};
  arguments[4] = SIGCHLD;
  return EndChild(Call(SYS_clone3, arguments.data(), sizeof arguments));
}

long OpenHow() {
  const std::uint64_t how[3] = {O_WRONLY, 0, 0};
  return Call(SYS_openat2, AT_FDCWD, other_file.c_str(), how, sizeof how);
}

constexpr auto kFiles = Guard::kFiles;
constexpr auto kCalls = Guard::kCalls;
constexpr auto kBoth = Guard::kBoth;
constexpr auto kLives = End::kLives;
constexpr auto kKilled = End::kKilled;
constexpr auto kSucceeds = Free::kSucceeds;
constexpr auto kUnknown = Free::kUnknown;

// Arguments of calls that need privileges are wrong in addition: nothing is to happen where the
// filter has a hole.
const Attack kAttacks[] = {
    // Reading
    {"read_other_file", kFiles, kLives, kSucceeds, [] { return Open(other_file, O_RDONLY) + 0L; }},
    {"read_etc_passwd", kFiles, kLives, kSucceeds,
     [] { return Open("/etc/passwd", O_RDONLY) + 0L; }},
    {"read_through_link", kFiles, kLives, kSucceeds,
     [] { return Open(readable_file + ".link", O_RDONLY) + 0L; }},
    {"list_root", kFiles, kLives, kSucceeds, [] { return Open("/", O_RDONLY | O_DIRECTORY) + 0L; }},
    {"read_parents_memory", kFiles, kLives, kSucceeds,
     [] { return Open(parents_memory, O_RDONLY) + 0L; }},
    {"write_parents_memory", kBoth, kLives, kSucceeds,
     [] { return Open(parents_memory, O_RDWR) + 0L; }},

    // Writing by path
    {"write_readable_file", kBoth, kLives, kSucceeds,
     [] { return Open(readable_file, O_WRONLY) + 0L; }},
    {"write_other_file", kBoth, kLives, kSucceeds, [] { return Open(other_file, O_RDWR) + 0L; }},
    {"write_with_high_bits", kBoth, kLives, kSucceeds,
     [] { return Call(SYS_openat, AT_FDCWD, other_file.c_str(), (1L << 40) | O_WRONLY); }},
    // For ioctl() alone; Landlock does not mind.
    {"open_mode_3", kCalls, kLives, kSucceeds, [] { return Open(readable_file, O_ACCMODE) + 0L; }},
    {"empty_by_open", kBoth, kLives, kSucceeds,
     [] { return Open(readable_file, O_RDONLY | O_TRUNC) + 0L; }},
    {"append", kBoth, kLives, kSucceeds,
     [] { return Open(readable_file, O_WRONLY | O_APPEND) + 0L; }},
    {"create", kBoth, kLives, kSucceeds, [] { return Open(new_file, O_RDONLY | O_CREAT) + 0L; }},
    {"create_without_name", kBoth, kLives, kUnknown,
     [] { return Open(fs::path(new_file).parent_path(), O_TMPFILE | O_RDWR) + 0L; }},
    {"openat2", kBoth, kLives, kSucceeds, OpenHow},
    {"write_memory_file_by_path", kCalls, kLives, kSucceeds,
     [] { return Open(memory_file_path, O_WRONLY) + 0L; }},
    {"unlink", kBoth, kLives, kSucceeds, [] { return unlink(readable_file.c_str()) + 0L; }},
    {"rename", kBoth, kLives, kSucceeds,
     [] { return rename(readable_file.c_str(), new_file.c_str()) + 0L; }},
    {"link", kBoth, kLives, kSucceeds,
     [] { return link(readable_file.c_str(), new_file.c_str()) + 0L; }},
    {"symlink", kBoth, kLives, kSucceeds,
     [] { return symlink("/etc/passwd", new_file.c_str()) + 0L; }},
    {"mkdir", kBoth, kLives, kSucceeds, [] { return mkdir(new_file.c_str(), 0700) + 0L; }},
    {"rmdir", kBoth, kLives, kSucceeds,
     [] { return rmdir((other_file + ".folder").c_str()) + 0L; }},
    {"mknod_pipe", kBoth, kLives, kSucceeds,
     [] { return mknod(new_file.c_str(), S_IFIFO | 0600, 0) + 0L; }},
    {"mknod_device", kBoth, kLives, kUnknown,
     [] { return mknod(new_file.c_str(), S_IFCHR | 0600, 0x103) + 0L; }},
    {"truncate", kCalls, kLives, kSucceeds, [] { return truncate(readable_file.c_str(), 0) + 0L; }},
    {"chmod", kCalls, kLives, kSucceeds, [] { return chmod(readable_file.c_str(), 0777) + 0L; }},
    {"fchmod", kCalls, kLives, kSucceeds, [] { return fchmod(memory_file, 0777) + 0L; }},
    {"chown", kCalls, kLives, kSucceeds,
     [] { return chown(readable_file.c_str(), getuid(), getgid()) + 0L; }},
    {"utimensat", kCalls, kLives, kSucceeds,
     [] { return utimensat(AT_FDCWD, readable_file.c_str(), nullptr, 0) + 0L; }},
    {"setxattr", kCalls, kLives, kUnknown,
     [] { return setxattr(readable_file.c_str(), "user.x", "x", 1, 0) + 0L; }},
    {"removexattr", kCalls, kLives, kUnknown,
     [] { return removexattr(readable_file.c_str(), "user.x") + 0L; }},
    {"chroot", kCalls, kKilled, kUnknown, [] { return chroot("/none") + 0L; }},

    // Other processes
    {"ptrace_traceme", kCalls, kKilled, kSucceeds,
     [] { return ptrace(PTRACE_TRACEME, 0, nullptr, nullptr); }},
    {"ptrace_parent", kCalls, kKilled, kSucceeds,
     [] { return ptrace(PTRACE_SEIZE, parent, nullptr, nullptr); }},
    {"process_vm_readv", kCalls, kKilled, kSucceeds,
     [] { return CopyMemory(SYS_process_vm_readv); }},
    {"process_vm_writev", kCalls, kKilled, kSucceeds,
     [] { return CopyMemory(SYS_process_vm_writev); }},
    {"kill_parent", kCalls, kKilled, kSucceeds, [] { return kill(parent, 0) + 0L; }},
    {"kill_all", kCalls, kKilled, kUnknown, [] { return kill(-1, 0) + 0L; }},
    {"tkill_parent", kCalls, kKilled, kSucceeds, [] { return Call(SYS_tkill, parent, 0); }},
    {"tgkill_parent", kCalls, kKilled, kSucceeds,
     [] { return Call(SYS_tgkill, parent, parent, 0); }},
    {"rt_sigqueueinfo", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_rt_sigqueueinfo, parent, 0, nullptr); }},
    {"signal_parent_by_fcntl", kCalls, kLives, kSucceeds,
     [] { return fcntl(pipe_to_write, F_SETOWN, parent) + 0L; }},
    {"pidfd_open", kCalls, kKilled, kSucceeds, [] { return Call(SYS_pidfd_open, parent, 0); }},
    {"pidfd_getfd", kCalls, kKilled, kUnknown, [] { return Call(SYS_pidfd_getfd, -1, 0, 0); }},
    {"pidfd_send_signal", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_pidfd_send_signal, -1, 0, nullptr, 0); }},
    {"process_madvise", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_process_madvise, -1, nullptr, 0, 0, 0); }},
    {"kcmp", kCalls, kKilled, kUnknown, [] { return Call(SYS_kcmp, parent, parent, 0, 0, 0); }},
    {"prlimit_parent", kCalls, kLives, kSucceeds, LimitParent},
    {"setaffinity_parent", kCalls, kLives, kSucceeds, PinParent},
    {"setpriority_parent", kCalls, kLives, kSucceeds,
     [] { return setpriority(PRIO_PROCESS, static_cast<id_t>(parent), 19) + 0L; }},
    {"fork", kCalls, kKilled, kSucceeds, [] { return EndChild(fork()); }},
    {"vfork", kCalls, kKilled, kSucceeds, [] { return EndChild(vfork()); }},
    {"clone3", kCalls, kLives, kSucceeds, Clone3},
    {"execve", kCalls, kKilled, kSucceeds, RunTrue},
    {"execveat", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_execveat, memory_file, "", nullptr, nullptr, AT_EMPTY_PATH); }},

    // The network
    {"socket_inet", kCalls, kKilled, kSucceeds,
     [] { return socket(AF_INET, SOCK_STREAM, 0) + 0L; }},
    {"socket_inet6", kCalls, kKilled, kUnknown,
     [] { return socket(AF_INET6, SOCK_DGRAM, 0) + 0L; }},
    {"socket_unix", kCalls, kKilled, kSucceeds,
     [] { return socket(AF_UNIX, SOCK_STREAM, 0) + 0L; }},
    {"socket_netlink", kCalls, kKilled, kUnknown,
     [] { return socket(AF_NETLINK, SOCK_RAW, 0) + 0L; }},
    {"socket_packet", kCalls, kKilled, kUnknown,
     [] { return socket(AF_PACKET, SOCK_RAW, 0) + 0L; }},
    {"socket_vsock", kCalls, kKilled, kUnknown,
     [] { return socket(AF_VSOCK, SOCK_STREAM, 0) + 0L; }},
    {"socket_alg", kCalls, kKilled, kUnknown,
     [] { return socket(AF_ALG, SOCK_SEQPACKET, 0) + 0L; }},
    {"socketpair", kCalls, kKilled, kSucceeds,
     [] {
       int ends[2];
       return socketpair(AF_UNIX, SOCK_STREAM, 0, ends) + 0L;
     }},
    {"connect", kCalls, kKilled, kUnknown, [] { return connect(-1, nullptr, 0) + 0L; }},
    {"bind", kCalls, kKilled, kUnknown, [] { return bind(-1, nullptr, 0) + 0L; }},
    {"sendmsg", kCalls, kKilled, kUnknown, [] { return sendmsg(-1, nullptr, 0) + 0L; }},
    {"recvmsg", kCalls, kKilled, kUnknown, [] { return recvmsg(-1, nullptr, 0) + 0L; }},

    // Memory that is code
    {"make_code", kCalls, kLives, kSucceeds, MakeCode},
    {"map_code", kCalls, kLives, kSucceeds,
     [] { return Map(PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1); }},
    {"map_code_of_memory_file", kCalls, kLives, kSucceeds,
     [] { return Map(PROT_READ | PROT_EXEC, MAP_SHARED, memory_file); }},
    {"pkey_mprotect", kCalls, kLives, kUnknown,
     [] { return Call(SYS_pkey_mprotect, nullptr, 0, PROT_READ | PROT_EXEC, -1); }},
    {"memfd_create", kCalls, kKilled, kSucceeds, [] { return memfd_create("x", 0) + 0L; }},
    {"poison_memory", kCalls, kLives, kUnknown,
     [] { return madvise(nullptr, 0, MADV_HWPOISON) + 0L; }},

    // Privileges, the process's own limits, and the machine
    {"stop_timeout", kCalls, kLives, kSucceeds,
     [] {
       const itimerval none{};
       return setitimer(ITIMER_REAL, &none, nullptr) + 0L;
     }},
    {"setrlimit", kCalls, kLives, kSucceeds,
     [] {
       rlimit limit{};
       getrlimit(RLIMIT_CPU, &limit);
       return setrlimit(RLIMIT_CPU, &limit) + 0L;
     }},
    {"sched_setscheduler", kCalls, kLives, kSucceeds, KeepScheduling},
    {"prctl_dumpable", kCalls, kLives, kSucceeds, [] { return prctl(PR_SET_DUMPABLE, 1) + 0L; }},
    {"prctl_ptracer", kCalls, kLives, kUnknown,
     [] { return prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY) + 0L; }},
    {"personality", kCalls, kKilled, kSucceeds, [] { return Call(SYS_personality, 0xffffffffL); }},
    {"type_into_terminal", kCalls, kLives, kUnknown,
     [] { return ioctl(pipe_to_write, TIOCSTI, "x") + 0L; }},
    {"setuid", kCalls, kLives, kSucceeds, [] { return setuid(getuid()) + 0L; }},
    {"setgid", kCalls, kLives, kSucceeds, [] { return setgid(getgid()) + 0L; }},
    {"setsid", kCalls, kLives, kSucceeds, [] { return setsid() + 0L; }},
    {"capset", kCalls, kKilled, kUnknown, LoseCapabilities},
    {"mount", kCalls, kKilled, kUnknown,
     [] { return mount("none", "/none", "none", 0, nullptr) + 0L; }},
    {"umount", kCalls, kKilled, kUnknown, [] { return umount2("/none", 0) + 0L; }},
    {"pivot_root", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_pivot_root, "/none", "/none"); }},
    {"fsopen", kCalls, kKilled, kUnknown, [] { return Call(SYS_fsopen, "none", 0); }},
    {"open_tree", kCalls, kKilled, kUnknown, [] { return Call(SYS_open_tree, -1, "none", 0); }},
    {"setns", kCalls, kKilled, kUnknown, [] { return setns(-1, 0) + 0L; }},
    {"unshare", kCalls, kKilled, kSucceeds, [] { return unshare(0) + 0L; }},
    {"name_to_handle_at", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_name_to_handle_at, AT_FDCWD, "/none", nullptr, nullptr, 0); }},
    {"open_by_handle_at", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_open_by_handle_at, -1, nullptr, 0); }},
    {"reboot", kCalls, kKilled, kUnknown, [] { return Call(SYS_reboot, 0, 0, 0, nullptr); }},
    {"init_module", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_init_module, nullptr, 0, ""); }},
    {"finit_module", kCalls, kKilled, kUnknown, [] { return Call(SYS_finit_module, -1, "", 0); }},
    {"delete_module", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_delete_module, "palpate-none", 0); }},
    {"kexec_load", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_kexec_load, 0, 0, nullptr, 0xfefefefeL); }},
    {"swapon", kCalls, kKilled, kUnknown, [] { return Call(SYS_swapon, "/none", 0); }},
    {"syslog", kCalls, kLives, kUnknown, [] { return Call(SYS_syslog, -1, nullptr, 0); }},
    {"sethostname", kCalls, kLives, kUnknown, [] { return Call(SYS_sethostname, nullptr, -1); }},
#ifdef SYS_ioperm
    {"ioperm", kCalls, kKilled, kUnknown, [] { return Call(SYS_ioperm, 0x10000000L, 1, 0); }},
    {"iopl", kCalls, kKilled, kUnknown, [] { return Call(SYS_iopl, 9); }},
#endif
#ifdef SYS_modify_ldt
    {"modify_ldt", kCalls, kKilled, kUnknown, [] { return Call(SYS_modify_ldt, 9, nullptr, 0); }},
#endif
#if defined(__x86_64__) && defined(__LP64__)
    {"number_of_another_architecture", kCalls, kKilled, kUnknown,
     [] { return Call(0x40000000L | SYS_getpid); }},
#endif

    // Parts of the kernel that readers do not need
    {"bpf", kCalls, kKilled, kUnknown, [] { return Call(SYS_bpf, -1, nullptr, 0); }},
    {"perf_event_open", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_perf_event_open, nullptr, 0, -1, -1, 0); }},
    {"io_uring_setup", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_io_uring_setup, 1, nullptr); }},
    {"io_uring_enter", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_io_uring_enter, -1, 0, 0, 0, nullptr, 0); }},
    {"io_uring_register", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_io_uring_register, -1, 0, nullptr, 0); }},
    {"userfaultfd", kCalls, kKilled, kUnknown, [] { return Call(SYS_userfaultfd, -1); }},
    {"keyctl", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_keyctl, KEYCTL_GET_KEYRING_ID, KEY_SPEC_SESSION_KEYRING, 0); }},
    {"add_key", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_add_key, nullptr, nullptr, nullptr, 0, 0); }},
    {"request_key", kCalls, kKilled, kUnknown,
     [] { return Call(SYS_request_key, nullptr, nullptr, nullptr, 0); }},
    {"inotify", kCalls, kLives, kSucceeds, [] { return inotify_init1(0) + 0L; }},
    {"epoll", kCalls, kLives, kSucceeds, [] { return epoll_create1(0) + 0L; }},
    {"io_setup", kCalls, kLives, kUnknown, [] { return Call(SYS_io_setup, 0, nullptr); }},
    {"shmget", kCalls, kLives, kUnknown, [] { return Call(SYS_shmget, 0, 0, 0); }},
    {"landlock", kCalls, kLives, kUnknown, [] { return Call(SYS_landlock_restrict_self, -1, 0); }},
    {"seccomp", kCalls, kLives, kUnknown, [] { return Call(SYS_seccomp, -1, 0, nullptr); }},
};

}  // namespace

std::span<const Attack> Attacks() { return kAttacks; }

}  // namespace palpate
