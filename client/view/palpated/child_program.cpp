#include "client/view/palpated/child_program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <thread>

#include "common/error/error.h"

extern char** environ;

namespace palpate::view {
namespace {

constexpr std::size_t kMostOutput = 64 * 1024;
constexpr std::chrono::milliseconds kPause{5};

struct SpawnSettings {
  // `out`: the descriptor for stdout; -1: both outputs go to `log`.
  SpawnSettings(int out, const std::string& log) {
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    if (out >= 0) {
      posix_spawn_file_actions_adddup2(&actions, out, 1);
      // Toolkits print warnings that nobody asked for.
      posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
    } else {
      posix_spawn_file_actions_addopen(&actions, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                       0600);
      posix_spawn_file_actions_adddup2(&actions, 1, 2);
    }
    // Connections and the graphics card are not the child's.
    posix_spawn_file_actions_addclosefrom_np(&actions, 3);
    posix_spawnattr_init(&attributes);
    sigset_t none;
    sigset_t all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSID);
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

[[noreturn]] void Fail(const std::string& program, int error_number) {
  throw Error(ErrorKind::kUnavailable,
              "cannot start " + program + ": " + std::strerror(error_number));
}

}  // namespace

std::string VariableOf(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

std::filesystem::path FindProgram(const std::string& name, const std::string& path_variable) {
  std::istringstream folders(path_variable);
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (folder.empty()) continue;
    const std::filesystem::path program = std::filesystem::path(folder) / name;
    std::error_code error;
    if (std::filesystem::is_regular_file(program, error) && access(program.c_str(), X_OK) == 0) {
      return program;
    }
  }
  return {};
}

ChildProgram::ChildProgram(std::vector<std::string> arguments, const std::filesystem::path& log) {
  std::array<int, 2> ends{-1, -1};
  if (log.empty() && pipe2(ends.data(), O_CLOEXEC) != 0) Fail(arguments.front(), errno);
  out_ = Descriptor(ends[0]);
  const Descriptor its_end(ends[1]);
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const SpawnSettings settings(its_end.get(), log.string());
  const int error =
      posix_spawn(&pid_, argv[0], &settings.actions, &settings.attributes, argv.data(), environ);
  if (error != 0) Fail(arguments.front(), error);
  if (log.empty()) fcntl(out_.get(), F_SETFL, O_NONBLOCK);
}

ChildProgram::~ChildProgram() {
  if (!left_) End(std::chrono::seconds(1));
}

std::optional<int> ChildProgram::Poll() {
  if (exit_code_) return exit_code_;
  int status = 0;
  const bool has_ended = waitpid(pid_, &status, WNOHANG) == pid_;
  // After it has ended, all that it printed is there.
  std::array<char, 4096> part{};
  for (ssize_t n = 0; (n = read(out_.get(), part.data(), part.size())) > 0;) {
    const std::size_t room = kMostOutput - output_.size();
    output_.append(part.data(), std::min(room, static_cast<std::size_t>(n)));
  }
  if (has_ended) exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  return exit_code_;
}

void ChildProgram::End(std::chrono::milliseconds patience) {
  if (Poll()) return;
  // Its session is its group.
  kill(-pid_, SIGTERM);
  const auto end = std::chrono::steady_clock::now() + patience;
  while (!Poll()) {
    if (std::chrono::steady_clock::now() > end) kill(-pid_, SIGKILL);
    std::this_thread::sleep_for(kPause);
  }
}

}  // namespace palpate::view
