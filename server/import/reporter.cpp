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

// For the signal handlers, which may neither allocate nor format.
std::string timeout_line;
std::string crash_line;
int crash_code = 0;
int signal_fd = -1;

extern "C" void ExitOnTimeout(int) {
  [[maybe_unused]] const ssize_t written =
      write(signal_fd, timeout_line.data(), timeout_line.size());
  _exit(ExitCode(ErrorKind::kTooLarge));
}

extern "C" void ExitOnCrash(int) {
  [[maybe_unused]] const ssize_t written = write(signal_fd, crash_line.data(), crash_line.size());
  _exit(crash_code);
}

// Makes one line of any text from a library or a file name.
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
#ifndef PALPATE_SANITIZED
  // The sanitizers report to stderr.
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

void Reporter::Size(const std::array<std::int64_t, 3>& size, int bytes_per_voxel) {
  if (progress_fd_ < 0) return;
  WriteAll(progress_fd_, "size " + std::to_string(size[0]) + " " + std::to_string(size[1]) + " " +
                             std::to_string(size[2]) + " " + std::to_string(bytes_per_voxel) +
                             "\n");
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
  signal_fd = message_fd_;
  struct sigaction action = {};
  action.sa_handler = ExitOnTimeout;
  sigaction(SIGALRM, &action, nullptr);
  sigaction(SIGXCPU, &action, nullptr);
  alarm(seconds);
}

void Reporter::FailOnCrash(const std::string& message, ErrorKind kind) {
  crash_line = OneLine("palpate-import: " + input_ + ": " + message);
  crash_code = ExitCode(kind);
  signal_fd = message_fd_;
#ifndef PALPATE_SANITIZED
  // A stack of its own: the other one may be what overflowed.
  static std::array<char, 1 << 16> stack;
  const stack_t own{.ss_sp = stack.data(), .ss_flags = 0, .ss_size = stack.size()};
  sigaltstack(&own, nullptr);
  struct sigaction action = {};
  action.sa_handler = ExitOnCrash;
  action.sa_flags = SA_ONSTACK;
  for (const int signal : {SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV}) {
    sigaction(signal, &action, nullptr);
  }
#endif
}

}  // namespace palpate
