#include "server/import/reporter.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

// For the signal handler, which may neither allocate nor format.
std::string timeout_line;
int timeout_fd = -1;

extern "C" void ExitOnTimeout(int) {
  [[maybe_unused]] const ssize_t written =
      write(timeout_fd, timeout_line.data(), timeout_line.size());
  _exit(ExitCode(ErrorKind::kTooLarge));
}

// One line, whatever a library or a file name puts into it.
std::string OneLine(std::string_view text) {
  constexpr std::size_t kLongest = 2000;
  std::string line;
  for (const char c : text.substr(0, kLongest)) {
    const auto byte = static_cast<unsigned char>(c);
    const bool blank = byte < 0x20 || byte == 0x7f;
    if (!blank) line += c;
    if (blank && !line.empty() && line.back() != ' ') line += ' ';
  }
  while (line.ends_with(' ')) line.pop_back();
  return line + '\n';
}

void WriteAll(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t count = write(fd, text.data(), text.size());
    if (count <= 0) return;
    text.remove_prefix(static_cast<std::size_t>(count));
  }
}

}  // namespace

Reporter::Reporter(std::string input, bool show_progress) : input_(std::move(input)) {
  if (show_progress) progress_fd_ = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  message_fd_ = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 3);
  const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (nowhere < 0) return;
  dup2(nowhere, STDOUT_FILENO);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // The sanitizers report here.
  dup2(nowhere, STDERR_FILENO);
#endif
  close(nowhere);
}

void Reporter::Progress(double fraction, std::string_view stage) {
  if (progress_fd_ < 0) return;
  char text[160];
  const int count = std::snprintf(text, sizeof text, "progress %.3f %.*s\n", fraction,
                                  static_cast<int>(stage.size()), stage.data());
  if (count > 0 && static_cast<std::size_t>(count) < sizeof text) {
    WriteAll(progress_fd_, {text, static_cast<std::size_t>(count)});
  }
}

void Reporter::Warn(std::string_view message) {
  WriteAll(message_fd_,
           OneLine("palpate-import: warning: " + input_ + ": " + std::string(message)));
}

void Reporter::Fail(std::string_view message) {
  WriteAll(message_fd_, OneLine("palpate-import: " + input_ + ": " + std::string(message)));
}

void Reporter::FailAfter(unsigned seconds) {
  timeout_line = OneLine("palpate-import: " + input_ + ": the import took longer than " +
                         std::to_string(seconds) + " s; crop the volume or raise the limit");
  timeout_fd = message_fd_;
  struct sigaction action = {};
  action.sa_handler = ExitOnTimeout;
  sigaction(SIGALRM, &action, nullptr);
  sigaction(SIGXCPU, &action, nullptr);
  alarm(seconds);
}

}  // namespace palpate
