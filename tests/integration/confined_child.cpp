// confined_child HOW WHAT FOLDER: tries one thing in a process that is confined as palpate-import
// is. confinement_test.cpp runs it.
//   HOW   readable: Confine() with FOLDER/readable; everywhere: with nothing;
//         linked: with FOLDER/link, a link to FOLDER/readable; threaded: as readable, while a
//         thread runs; free: without Confine()
//   WHAT  a row of kAttacks or kWorks below
// confined_child list: the rows of kAttacks.
//
// Exit codes: 0 it succeeded; its errno; 128 and the signal that ended it.
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
#include <sys/wait.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/import/confinement.h"
#include "server/import/file_start.h"
#include "server/import/reporter.h"
#include "server/import/resource_limits.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr int kSignalled = 128;
constexpr int kNotSetUp = 127;
constexpr std::string_view kTimeout = "run_out_of_time";

// Made before Confine().
pid_t parent = 0;
int memory_file = -1;
int pipe_to_write = -1;
std::string readable_file;
std::string other_file;
std::string new_file;
std::string parents_memory;
std::string memory_file_path;
char bytes[4096];

int Open(const std::string& path, int flags) { return open(path.c_str(), flags | O_CLOEXEC, 0600); }

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

// What refuses it. Sanitizer builds have kFiles alone.
enum class Guard { kFiles, kCalls, kBoth };
// What becomes of the process.
enum class End { kLives, kKilled };
// What happens without Confine() and without privileges.
enum class Free { kSucceeds, kUnknown };

struct Attack {
  const char* name;
  Guard guard;
  End end;
  Free free;
  long (*attempt)();  // as a system call: -1 and errno
};

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

// --- What readers do

void Check(bool done, const char* what) {
  if (!done) throw std::runtime_error(std::string(what) + ": " + std::strerror(errno));
}

void ReadFiles() {
  std::ifstream in(readable_file);
  std::string text;
  Check(std::getline(in, text) && text == "readable", "read");
  Check(access(readable_file.c_str(), R_OK) == 0, "access");
  int count = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(readable_file).parent_path())) {
    count += entry.is_regular_file();
  }
  Check(count > 0, "list");
  Check(fs::weakly_canonical(readable_file) == readable_file, "weakly_canonical");
  const int file = Open(readable_file, O_RDONLY);
  Check(mmap(nullptr, 1, PROT_READ, MAP_PRIVATE, file, 0) != MAP_FAILED, "map");
  close(file);
}

void ReadFileStart() {
  for (const std::string expected : {"read", "readable"}) {
    const FileStart start(readable_file, static_cast<std::int64_t>(expected.size()));
    std::ifstream in(start.path());
    std::string text;
    Check(std::getline(in, text).eof() && text == expected, "read the start");
  }
}

void WriteMemoryFile() {
  constexpr int kSize = 1 << 20;
  Check(ftruncate(memory_file, kSize) == 0, "ftruncate");
  Check(fallocate(memory_file, 0, 0, 2 * kSize) == 0, "fallocate");
  Check(write(memory_file, "a", 1) == 1, "write");
  Check(pwrite(memory_file, "b", 1, kSize) == 1, "pwrite");
  Check(lseek(memory_file, 0, SEEK_END) == 2 * kSize, "lseek");
  auto* const map =
      static_cast<char*>(mmap(nullptr, kSize, PROT_READ | PROT_WRITE, MAP_SHARED, memory_file, 0));
  Check(map != MAP_FAILED && map[0] == 'a', "mmap");
  map[1] = 'c';
  Check(msync(map, kSize, MS_SYNC) == 0 && munmap(map, kSize) == 0, "munmap");
  Check(fsync(memory_file) == 0, "fsync");
  Check(fcntl(memory_file, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE) == 0, "seal");
  Check(write(memory_file, "a", 1) < 0, "be sealed");
}

void WritePipe() {
  iovec part{bytes, 1};
  Check(write(pipe_to_write, bytes, 1) == 1 && writev(pipe_to_write, &part, 1) == 1, "write");
}

void StartThreads() {
  int sum = 0;
  for (int k = 0; k < 3; ++k) {
    std::thread([&sum, k] {
      prctl(PR_SET_NAME, "reader");
      std::vector<int> numbers(1000, k);
      sum += numbers[999];
      try {
        throw std::runtime_error("in a thread");
      } catch (const std::exception&) {
        ++sum;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }).join();
  }
  Check(sum == 6, "add");
}

void AllocateMemory() {
  std::vector<char> large(std::size_t{64} << 20, 'x');
  large.resize(std::size_t{80} << 20);
  Check(large[1] == 'x', "remember");
  std::vector<char>().swap(large);
  for (int k = 1; k < 200; ++k) {
    free(realloc(malloc(static_cast<std::size_t>(k) * 1000), static_cast<std::size_t>(k) * 9000));
  }
}

void ThrowAndCatch() {
  try {
    throw Error(ErrorKind::kTooLarge, "thrown");
  } catch (const Error& error) {
    Check(error.kind() == ErrorKind::kTooLarge, "catch");
  }
}

void AskTheTime() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::time_t seconds = std::chrono::duration_cast<std::chrono::seconds>(now).count();
  Check(std::localtime(&seconds) != nullptr, "localtime");
  Check(std::thread::hardware_concurrency() > 0, "count processors");
}

// The reporter's handlers end the next three with its message.
void Crash() { std::abort(); }
void CrashInAThread() { std::thread(Crash).join(); }
void RunOutOfTime() { std::this_thread::sleep_for(std::chrono::seconds(20)); }

struct Work {
  const char* name;
  void (*done)();
};

const Work kWorks[] = {
    {"read_files", ReadFiles},
    {"read_file_start", ReadFileStart},
    {"write_memory_file", WriteMemoryFile},
    {"write_pipe", WritePipe},
    {"start_threads", StartThreads},
    {"allocate_memory", AllocateMemory},
    {"throw_and_catch", ThrowAndCatch},
    {"ask_the_time", AskTheTime},
    {"crash", Crash},
    {"crash_in_a_thread", CrashInAThread},
    {kTimeout.data(), RunOutOfTime},
};

// --- Two processes: the confined one, and its parent, which is attacked

void SetUp(const fs::path& folder) {
  parent = getpid();
  readable_file = folder / "readable/file";
  other_file = folder / "other/file";
  new_file = folder / "readable/new";
  parents_memory = "/proc/" + std::to_string(parent) + "/mem";
  memory_file = memfd_create("output", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  memory_file_path = "/proc/self/fd/" + std::to_string(memory_file);
  int ends[2] = {-1, -1};
  Check(memory_file >= 0 && pipe(ends) == 0, "make files");
  Check(ftruncate(memory_file, sizeof bytes) == 0, "make files");
  pipe_to_write = ends[1];
  // Yama allows a process to be traced by its children only if it says so.
  prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY);
}

// As palpate-import.
void ConfineAsTold(std::string_view how, std::string_view what, const fs::path& folder,
                   Reporter* reporter) {
  reporter->FailOnCrash();
  reporter->FailAfter(what == kTimeout ? 1 : 60);
  LimitResources(std::int64_t{1} << 28, 100);
  FileStart::Reserve();
  if (how == "threaded") std::thread(RunOutOfTime).detach();
  if (how == "readable" || how == "threaded") Confine({folder / "readable"});
  if (how == "everywhere") Confine({});
  if (how == "linked") Confine({folder / "link"});
}

int Try(std::string_view what) {
  for (const Attack& attack : kAttacks) {
    if (what != attack.name) continue;
    return attack.attempt() < 0 ? errno : 0;
  }
  for (const Work& work : kWorks) {
    if (what != work.name) continue;
    work.done();
    return 0;
  }
  throw std::runtime_error("no such row");
}

int RunConfined(std::string_view how, std::string_view what, const fs::path& folder) {
  Reporter reporter(std::string(what), false);
  try {
    ConfineAsTold(how, what, folder, &reporter);
    return Try(what);
  } catch (const std::exception& error) {
    reporter.Fail(error.what());
    return kNotSetUp;
  }
}

void List() {
  for (const Attack& attack : kAttacks) {
    std::printf("%s %s %s %s\n", attack.name,
                attack.guard == kFiles   ? "files"
                : attack.guard == kCalls ? "calls"
                                         : "both",
                attack.end == kKilled ? "killed" : "lives",
                attack.free == kSucceeds ? "succeeds" : "unknown");
  }
}

int Run(std::string_view how, std::string_view what, const fs::path& folder) {
  SetUp(folder);
  const pid_t child = fork();
  if (child < 0) return kNotSetUp;
  // _exit(): the sanitizers' search for leaks is no part of this.
  if (child == 0) _exit(RunConfined(how, what, folder));
  int status = 0;
  if (waitpid(child, &status, 0) != child) return kNotSetUp;
  return WIFEXITED(status) ? WEXITSTATUS(status) : kSignalled + WTERMSIG(status);
}

}  // namespace
}  // namespace palpate

int main(int count, char** arguments) {
  if (count == 2 && std::string_view(arguments[1]) == "list") {
    palpate::List();
    return 0;
  }
  if (count != 4) return palpate::kUsageExitCode;
  return palpate::Run(arguments[1], arguments[2], arguments[3]);
}
