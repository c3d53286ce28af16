#include "client/view/palpated/child_program.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <system_error>
#include <thread>
#include <utility>

#include "common/error/error.h"

namespace palpate::view {
namespace {

constexpr std::size_t kMostOutput = 64 * 1024;
constexpr std::chrono::milliseconds kPause{5};
constexpr auto kOwnSession = ChildProcess::Group::kOwnSession;

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
  Pipe pipe;
  try {
    if (log.empty()) {
      pipe = MakePipe();
      // Toolkits print warnings that nobody asked for.
      process_.emplace(arguments, std::array{-1, pipe.write.get(), -1}, kOwnSession);
    } else {
      const Descriptor file(open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
      if (file.get() < 0) throw std::system_error(errno, std::generic_category());
      process_.emplace(arguments, std::array{-1, file.get(), file.get()}, kOwnSession);
    }
  } catch (const std::system_error& error) {
    throw Error(ErrorKind::kUnavailable,
                "cannot start " + arguments.front() + ": " + std::strerror(error.code().value()));
  }
  out_ = std::move(pipe.read);
}

ChildProgram::~ChildProgram() {
  if (!left_) End(std::chrono::seconds(1));
}

std::optional<int> ChildProgram::Poll() {
  if (exit_code_) return exit_code_;
  const std::optional<int> status = process_->Poll();
  // After it has ended, all that it printed is there.
  std::array<char, 4096> part{};
  for (ssize_t n = 0; (n = read(out_.get(), part.data(), part.size())) > 0;) {
    const std::size_t room = kMostOutput - output_.size();
    output_.append(part.data(), std::min(room, static_cast<std::size_t>(n)));
  }
  if (status) exit_code_ = WIFEXITED(*status) ? WEXITSTATUS(*status) : -WTERMSIG(*status);
  return exit_code_;
}

void ChildProgram::End(std::chrono::milliseconds patience) {
  if (Poll()) return;
  process_->Signal(SIGTERM);
  const auto end = std::chrono::steady_clock::now() + patience;
  while (!Poll()) {
    if (std::chrono::steady_clock::now() > end) process_->Signal(SIGKILL);
    std::this_thread::sleep_for(kPause);
  }
}

}  // namespace palpate::view
