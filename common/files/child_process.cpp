#include "common/files/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <system_error>

extern char** environ;

namespace palpate {
namespace {

struct SpawnSettings {
  SpawnSettings(std::span<const int> descriptors, ChildProcess::Group group) {
    posix_spawn_file_actions_init(&actions);
    int n = 0;
    for (const int descriptor : descriptors) {
      if (descriptor < 0) {
        posix_spawn_file_actions_addopen(&actions, n, "/dev/null", O_RDWR, 0);
      } else {
        posix_spawn_file_actions_adddup2(&actions, descriptor, n);
      }
      ++n;
    }
    posix_spawn_file_actions_addclosefrom_np(&actions, n);
    posix_spawnattr_init(&attributes);
    sigset_t none;
    sigset_t all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0);
    const int own =
        group == ChildProcess::Group::kOwnGroup ? POSIX_SPAWN_SETPGROUP : POSIX_SPAWN_SETSID;
    posix_spawnattr_setflags(
        &attributes, static_cast<short>(POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | own));
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;

  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
};

}  // namespace

Pipe MakePipe() {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) throw std::system_error(errno, std::generic_category());
  Pipe pipe{Descriptor(ends[0]), Descriptor(ends[1])};
  fcntl(pipe.read.get(), F_SETFL, O_NONBLOCK);
  return pipe;
}

ChildProcess::ChildProcess(std::vector<std::string> arguments, std::span<const int> descriptors,
                           Group group) {
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  // Out of the way of the numbers that are filled.
  std::vector<int> given(descriptors.begin(), descriptors.end());
  std::vector<Descriptor> lifted;
  const int count = static_cast<int>(given.size());
  for (int& descriptor : given) {
    if (descriptor < 0 || descriptor >= count) continue;
    descriptor = lifted.emplace_back(fcntl(descriptor, F_DUPFD_CLOEXEC, count)).get();
    if (descriptor < 0) throw std::system_error(errno, std::generic_category());
  }
  const SpawnSettings settings(given, group);
  const int error =
      posix_spawn(&pid_, argv[0], &settings.actions, &settings.attributes, argv.data(), environ);
  if (error != 0) throw std::system_error(error, std::generic_category());
}

ChildProcess::~ChildProcess() {
  if (left_ || Poll()) return;
  Signal(SIGKILL);
  while (waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

std::optional<int> ChildProcess::Poll() {
  int status = 0;
  if (!status_ && waitpid(pid_, &status, WNOHANG) == pid_) status_ = status;
  return status_;
}

void ChildProcess::Signal(int number) {
  // Its session, too, is a group.
  if (!status_) kill(-pid_, number);
}

}  // namespace palpate
