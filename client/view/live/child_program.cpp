#include "client/view/live/child_program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
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

class SpawnSettings {
 public:
  // `out`: the descriptor for stdout; -1: both outputs go to `log`.
  SpawnSettings(int out, const std::string& log) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addopen(&actions_, 0, "/dev/null", O_RDONLY, 0);
    if (out >= 0) {
      posix_spawn_file_actions_adddup2(&actions_, out, 1);
      // Toolkits print warnings that nobody asked for.
      posix_spawn_file_actions_addopen(&actions_, 2, "/dev/null", O_WRONLY, 0);
    } else {
      posix_spawn_file_actions_addopen(&actions_, 1, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                       0600);
      posix_spawn_file_actions_adddup2(&actions_, 1, 2);
    }
    // Connections and the graphics card are not the child's.
    posix_spawn_file_actions_addclosefrom_np(&actions_, 3);
    posix_spawnattr_init(&attributes_);
    sigset_t none;
    sigset_t all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    posix_spawnattr_setflags(&attributes_,
                             POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSID);
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;
  const posix_spawn_file_actions_t* actions() const { return &actions_; }
  const posix_spawnattr_t* attributes() const { return &attributes_; }

 private:
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
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
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const SpawnSettings settings(ends[1], log.string());
  const int error =
      posix_spawn(&pid_, argv[0], settings.actions(), settings.attributes(), argv.data(), environ);
  if (ends[1] >= 0) close(ends[1]);
  out_ = ends[0];
  if (error != 0) {
    if (out_ >= 0) close(out_);
    Fail(arguments.front(), error);
  }
  if (out_ >= 0) fcntl(out_, F_SETFL, O_NONBLOCK);
}

ChildProgram::~ChildProgram() {
  if (!left_) End(std::chrono::seconds(1));
  if (out_ >= 0) close(out_);
}

void ChildProgram::ReadOutput() {
  if (out_ < 0) return;
  std::array<char, 4096> part{};
  for (ssize_t n = 0; (n = read(out_, part.data(), part.size())) > 0;) {
    const std::size_t room = kMostOutput - output_.size();
    output_.append(part.data(), std::min(room, static_cast<std::size_t>(n)));
  }
}

std::optional<int> ChildProgram::Poll() {
  if (exit_code_) return exit_code_;
  int status = 0;
  const bool has_ended = waitpid(pid_, &status, WNOHANG) == pid_;
  // After it has ended, all that it printed is there.
  ReadOutput();
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
