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

using enum Guard;
using enum Free;

// Arguments of calls that need privileges are wrong in addition: nothing is to happen where the
// filter has a hole.
const Attack kAttacks[] = {
    // Reading
    {"read_other_file", kFiles, kSucceeds, [] { return Open(other_file, O_RDONLY); }},
    {"read_etc_passwd", kFiles, kSucceeds, [] { return Open("/etc/passwd", O_RDONLY); }},
    {"read_through_link", kFiles, kSucceeds,
     [] { return Open(readable_file + ".link", O_RDONLY); }},
    {"list_root", kFiles, kSucceeds, [] { return Open("/", O_RDONLY | O_DIRECTORY); }},
    {"read_parents_memory", kFiles, kSucceeds, [] { return Open(parents_memory, O_RDONLY); }},
    {"write_parents_memory", kBoth, kSucceeds, [] { return Open(parents_memory, O_RDWR); }},

    // Writing by path
    {"write_readable_file", kBoth, kSucceeds, [] { return Open(readable_file, O_WRONLY); }},
    {"write_other_file", kBoth, kSucceeds, [] { return Open(other_file, O_RDWR); }},
    {"write_with_high_bits", kBoth, kSucceeds,
     [] { return Call(SYS_openat, AT_FDCWD, other_file.c_str(), (1L << 40) | O_WRONLY); }},
    // For ioctl() alone; Landlock does not mind.
    {"open_mode_3", kCalls, kSucceeds, [] { return Open(readable_file, O_ACCMODE); }},
    {"empty_by_open", kBoth, kSucceeds, [] { return Open(readable_file, O_RDONLY | O_TRUNC); }},
    {"append", kBoth, kSucceeds, [] { return Open(readable_file, O_WRONLY | O_APPEND); }},
    {"create", kBoth, kSucceeds, [] { return Open(new_file, O_RDONLY | O_CREAT); }},
    {"create_without_name", kBoth, kUnknown,
     [] { return Open(fs::path(new_file).parent_path(), O_TMPFILE | O_RDWR); }},
    {"openat2", kBoth, kSucceeds, OpenHow},
    {"write_memory_file_by_path", kCalls, kSucceeds,
     [] { return Open(memory_file_path, O_WRONLY); }},
    {"unlink", kBoth, kSucceeds, [] { return unlink(readable_file.c_str()); }},
    {"rename", kBoth, kSucceeds, [] { return rename(readable_file.c_str(), new_file.c_str()); }},
    {"link", kBoth, kSucceeds, [] { return link(readable_file.c_str(), new_file.c_str()); }},
    {"symlink", kBoth, kSucceeds, [] { return symlink("/etc/passwd", new_file.c_str()); }},
    {"mkdir", kBoth, kSucceeds, [] { return mkdir(new_file.c_str(), 0700); }},
    {"rmdir", kBoth, kSucceeds, [] { return rmdir((other_file + ".folder").c_str()); }},
    {"mknod_pipe", kBoth, kSucceeds, [] { return mknod(new_file.c_str(), S_IFIFO | 0600, 0); }},
    {"mknod_device", kBoth, kUnknown,
     [] { return mknod(new_file.c_str(), S_IFCHR | 0600, 0x103); }},
    {"truncate", kCalls, kSucceeds, [] { return truncate(readable_file.c_str(), 0); }},
    {"chmod", kCalls, kSucceeds, [] { return chmod(readable_file.c_str(), 0777); }},
    {"fchmod", kCalls, kSucceeds, [] { return fchmod(memory_file, 0777); }},
    {"chown", kCalls, kSucceeds, [] { return chown(readable_file.c_str(), getuid(), getgid()); }},
    {"utimensat", kCalls, kSucceeds,
     [] { return utimensat(AT_FDCWD, readable_file.c_str(), nullptr, 0); }},
    {"setxattr", kCalls, kUnknown,
     [] { return setxattr(readable_file.c_str(), "user.x", "x", 1, 0); }},
    {"removexattr", kCalls, kUnknown, [] { return removexattr(readable_file.c_str(), "user.x"); }},
    {"chroot", kKills, kUnknown, [] { return chroot("/none"); }},

    // Other processes
    {"ptrace_traceme", kKills, kSucceeds,
     [] { return ptrace(PTRACE_TRACEME, 0, nullptr, nullptr); }},
    {"ptrace_parent", kKills, kSucceeds,
     [] { return ptrace(PTRACE_SEIZE, parent, nullptr, nullptr); }},
    {"process_vm_readv", kKills, kSucceeds, [] { return CopyMemory(SYS_process_vm_readv); }},
    {"process_vm_writev", kKills, kSucceeds, [] { return CopyMemory(SYS_process_vm_writev); }},
    {"kill_parent", kKills, kSucceeds, [] { return kill(parent, 0); }},
    {"kill_all", kKills, kUnknown, [] { return kill(-1, 0); }},
    {"tkill_parent", kKills, kSucceeds, [] { return Call(SYS_tkill, parent, 0); }},
    {"tgkill_parent", kKills, kSucceeds, [] { return Call(SYS_tgkill, parent, parent, 0); }},
    {"rt_sigqueueinfo", kKills, kUnknown,
     [] { return Call(SYS_rt_sigqueueinfo, parent, 0, nullptr); }},
    {"signal_parent_by_fcntl", kCalls, kSucceeds,
     [] { return fcntl(pipe_to_write, F_SETOWN, parent); }},
    {"pidfd_open", kKills, kSucceeds, [] { return Call(SYS_pidfd_open, parent, 0); }},
    {"pidfd_getfd", kKills, kUnknown, [] { return Call(SYS_pidfd_getfd, -1, 0, 0); }},
    {"pidfd_send_signal", kKills, kUnknown,
     [] { return Call(SYS_pidfd_send_signal, -1, 0, nullptr, 0); }},
    {"process_madvise", kKills, kUnknown,
     [] { return Call(SYS_process_madvise, -1, nullptr, 0, 0, 0); }},
    {"kcmp", kKills, kUnknown, [] { return Call(SYS_kcmp, parent, parent, 0, 0, 0); }},
    {"prlimit_parent", kCalls, kSucceeds, LimitParent},
    {"setaffinity_parent", kCalls, kSucceeds, PinParent},
    {"setpriority_parent", kCalls, kSucceeds,
     [] { return setpriority(PRIO_PROCESS, static_cast<id_t>(parent), 19); }},
    {"fork", kKills, kSucceeds, [] { return EndChild(fork()); }},
    {"vfork", kKills, kSucceeds, [] { return EndChild(vfork()); }},
    {"clone3", kCalls, kSucceeds, Clone3},
    {"execve", kKills, kSucceeds, RunTrue},
    {"execveat", kKills, kUnknown,
     [] { return Call(SYS_execveat, memory_file, "", nullptr, nullptr, AT_EMPTY_PATH); }},

    // The network
    {"socket_inet", kKills, kSucceeds, [] { return socket(AF_INET, SOCK_STREAM, 0); }},
    {"socket_inet6", kKills, kUnknown, [] { return socket(AF_INET6, SOCK_DGRAM, 0); }},
    {"socket_unix", kKills, kSucceeds, [] { return socket(AF_UNIX, SOCK_STREAM, 0); }},
    {"socket_netlink", kKills, kUnknown, [] { return socket(AF_NETLINK, SOCK_RAW, 0); }},
    {"socket_packet", kKills, kUnknown, [] { return socket(AF_PACKET, SOCK_RAW, 0); }},
    {"socket_vsock", kKills, kUnknown, [] { return socket(AF_VSOCK, SOCK_STREAM, 0); }},
    {"socket_alg", kKills, kUnknown, [] { return socket(AF_ALG, SOCK_SEQPACKET, 0); }},
    {"socketpair", kKills, kSucceeds,
     [] {
       int ends[2];
       return socketpair(AF_UNIX, SOCK_STREAM, 0, ends);
     }},
    {"connect", kKills, kUnknown, [] { return connect(-1, nullptr, 0); }},
    {"bind", kKills, kUnknown, [] { return bind(-1, nullptr, 0); }},
    {"sendmsg", kKills, kUnknown, [] { return sendmsg(-1, nullptr, 0); }},
    {"recvmsg", kKills, kUnknown, [] { return recvmsg(-1, nullptr, 0); }},

    // Memory
    {"make_code", kCalls, kSucceeds, MakeCode},
    {"map_code", kCalls, kSucceeds,
     [] { return Map(PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1); }},
    {"map_code_of_memory_file", kCalls, kSucceeds,
     [] { return Map(PROT_READ | PROT_EXEC, MAP_SHARED, memory_file); }},
    // The limit of memory counts neither.
    {"shared_memory", kCalls, kSucceeds,
     [] { return Map(PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1); }},
    {"growing_memory", kCalls, kSucceeds,
     [] { return Map(PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_GROWSDOWN, -1); }},
    {"pkey_mprotect", kCalls, kUnknown,
     [] { return Call(SYS_pkey_mprotect, nullptr, 0, PROT_READ | PROT_EXEC, -1); }},
    {"memfd_create", kKills, kSucceeds, [] { return memfd_create("x", 0); }},
    {"poison_memory", kCalls, kUnknown, [] { return madvise(nullptr, 0, MADV_HWPOISON); }},

    // Privileges, the process's own limits, and the machine
    {"stop_timeout", kCalls, kSucceeds,
     [] {
       const itimerval none{};
       return setitimer(ITIMER_REAL, &none, nullptr);
     }},
    {"setrlimit", kCalls, kSucceeds,
     [] {
       rlimit limit{};
       getrlimit(RLIMIT_CPU, &limit);
       return setrlimit(RLIMIT_CPU, &limit);
     }},
    {"sched_setscheduler", kCalls, kSucceeds, KeepScheduling},
    {"prctl_dumpable", kCalls, kSucceeds, [] { return prctl(PR_SET_DUMPABLE, 1); }},
    {"prctl_ptracer", kCalls, kUnknown, [] { return prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY); }},
    {"personality", kKills, kSucceeds, [] { return Call(SYS_personality, 0xffffffffL); }},
    {"type_into_terminal", kCalls, kUnknown, [] { return ioctl(pipe_to_write, TIOCSTI, "x"); }},
    {"setuid", kCalls, kSucceeds, [] { return setuid(getuid()); }},
    {"setgid", kCalls, kSucceeds, [] { return setgid(getgid()); }},
    {"setsid", kCalls, kSucceeds, [] { return setsid(); }},
    {"capset", kKills, kUnknown, LoseCapabilities},
    {"mount", kKills, kUnknown, [] { return mount("none", "/none", "none", 0, nullptr); }},
    {"umount", kKills, kUnknown, [] { return umount2("/none", 0); }},
    {"pivot_root", kKills, kUnknown, [] { return Call(SYS_pivot_root, "/none", "/none"); }},
    {"fsopen", kKills, kUnknown, [] { return Call(SYS_fsopen, "none", 0); }},
    {"open_tree", kKills, kUnknown, [] { return Call(SYS_open_tree, -1, "none", 0); }},
    {"setns", kKills, kUnknown, [] { return setns(-1, 0); }},
    {"unshare", kKills, kSucceeds, [] { return unshare(0); }},
    {"name_to_handle_at", kKills, kUnknown,
     [] { return Call(SYS_name_to_handle_at, AT_FDCWD, "/none", nullptr, nullptr, 0); }},
    {"open_by_handle_at", kKills, kUnknown,
     [] { return Call(SYS_open_by_handle_at, -1, nullptr, 0); }},
    {"reboot", kKills, kUnknown, [] { return Call(SYS_reboot, 0, 0, 0, nullptr); }},
    {"init_module", kKills, kUnknown, [] { return Call(SYS_init_module, nullptr, 0, ""); }},
    {"finit_module", kKills, kUnknown, [] { return Call(SYS_finit_module, -1, "", 0); }},
    {"delete_module", kKills, kUnknown, [] { return Call(SYS_delete_module, "palpate-none", 0); }},
    {"kexec_load", kKills, kUnknown,
     [] { return Call(SYS_kexec_load, 0, 0, nullptr, 0xfefefefeL); }},
    {"swapon", kKills, kUnknown, [] { return Call(SYS_swapon, "/none", 0); }},
    {"syslog", kCalls, kUnknown, [] { return Call(SYS_syslog, -1, nullptr, 0); }},
    {"sethostname", kCalls, kUnknown, [] { return Call(SYS_sethostname, nullptr, -1); }},
#ifdef SYS_ioperm
    {"ioperm", kKills, kUnknown, [] { return Call(SYS_ioperm, 0x10000000L, 1, 0); }},
    {"iopl", kKills, kUnknown, [] { return Call(SYS_iopl, 9); }},
#endif
#ifdef SYS_modify_ldt
    {"modify_ldt", kKills, kUnknown, [] { return Call(SYS_modify_ldt, 9, nullptr, 0); }},
#endif
#if defined(__x86_64__) && defined(__LP64__)
    {"number_of_another_architecture", kKills, kUnknown,
     [] { return Call(0x40000000L | SYS_getpid); }},
#endif

    // Parts of the kernel that readers do not need
    {"bpf", kKills, kUnknown, [] { return Call(SYS_bpf, -1, nullptr, 0); }},
    {"perf_event_open", kKills, kUnknown,
     [] { return Call(SYS_perf_event_open, nullptr, 0, -1, -1, 0); }},
    {"io_uring_setup", kKills, kUnknown, [] { return Call(SYS_io_uring_setup, 1, nullptr); }},
    {"io_uring_enter", kKills, kUnknown,
     [] { return Call(SYS_io_uring_enter, -1, 0, 0, 0, nullptr, 0); }},
    {"io_uring_register", kKills, kUnknown,
     [] { return Call(SYS_io_uring_register, -1, 0, nullptr, 0); }},
    {"userfaultfd", kKills, kUnknown, [] { return Call(SYS_userfaultfd, -1); }},
    {"keyctl", kKills, kUnknown,
     [] { return Call(SYS_keyctl, KEYCTL_GET_KEYRING_ID, KEY_SPEC_SESSION_KEYRING, 0); }},
    {"add_key", kKills, kUnknown,
     [] { return Call(SYS_add_key, nullptr, nullptr, nullptr, 0, 0); }},
    {"request_key", kKills, kUnknown,
     [] { return Call(SYS_request_key, nullptr, nullptr, nullptr, 0); }},
    {"inotify", kCalls, kSucceeds, [] { return inotify_init1(0); }},
    {"epoll", kCalls, kSucceeds, [] { return epoll_create1(0); }},
    {"io_setup", kCalls, kUnknown, [] { return Call(SYS_io_setup, 0, nullptr); }},
    {"shmget", kCalls, kUnknown, [] { return Call(SYS_shmget, 0, 0, 0); }},
    {"landlock", kCalls, kUnknown, [] { return Call(SYS_landlock_restrict_self, -1, 0); }},
    {"seccomp", kCalls, kUnknown, [] { return Call(SYS_seccomp, -1, 0, nullptr); }},
};

}  // namespace

std::span<const Attack> Attacks() { return kAttacks; }

}  // namespace palpate
