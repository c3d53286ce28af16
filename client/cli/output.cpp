#include "client/cli/output.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "client/program/interrupt.h"
#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate::cli {

void WriteOutput(std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = write(STDOUT_FILENO, text.data(), text.size());
    if (written >= 0) {
      text.remove_prefix(static_cast<std::size_t>(written));
      // A signal came when a part was written: nobody may ever read the rest.
      if (!text.empty() && Interrupt::IsRaised()) throw OutputClosed();
    } else if (errno == EPIPE || (errno == EINTR && Interrupt::IsRaised())) {
      throw OutputClosed();
    } else if (errno != EINTR) {
      throw Error(ErrorKind::kInternal,
                  std::string("cannot write the output: ") + std::strerror(errno));
    }
  }
}

bool IsTerminal(int file_descriptor) {
  const char* term = std::getenv("TERM");
  return isatty(file_descriptor) == 1 && term != nullptr && *term != '\0' &&
         std::strcmp(term, "dumb") != 0;
}

StatusLine::StatusLine() : is_terminal_(IsTerminal(STDERR_FILENO)) {}

void StatusLine::Show(const std::string& text) {
  if (!is_terminal_) return;
  std::fprintf(stderr, "\r\x1b[K%s", OneLine(text).substr(0, 79).c_str());
  drawn_ = true;
}

void StatusLine::Clear() {
  if (drawn_) std::fputs("\r\x1b[K", stderr);
  drawn_ = false;
}

TerminalSize SizeOfTerminal(int file_descriptor) {
  winsize size{};
  if (ioctl(file_descriptor, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) {
    return {};
  }
  return {size.ws_col, size.ws_row};
}

namespace {

constexpr int kProgressWidth = 30;
// In a pipe. Work that takes less leaves no line.
constexpr std::chrono::seconds kLinePeriod{2};

}  // namespace

ProgressPrinter::ProgressPrinter(std::function<Clock::time_point()> now)
    : is_terminal_(IsTerminal(STDERR_FILENO)), now_(std::move(now)), last_line_(now_()) {}

ProgressPrinter::~ProgressPrinter() {
  if (bar_drawn_) std::fputs("\r\x1b[K", stderr);
}

void ProgressPrinter::Print(std::string_view stage, double fraction, std::string_view detail) {
  fraction = std::clamp(fraction, 0.0, 1.0);
  const std::string text = OneLine(stage) + (detail.empty() ? "" : " " + OneLine(detail));
  if (is_terminal_) {
    const auto filled = static_cast<std::size_t>(fraction * kProgressWidth);
    fmt::print(stderr, "\r\x1b[K[{:<{}}] {:3.0f} % {:.36}", std::string(filled, '#'),
               kProgressWidth, 100.0 * fraction, text);
    bar_drawn_ = true;
    return;
  }
  const Clock::time_point now = now_();
  if (now - last_line_ < kLinePeriod) return;
  last_line_ = now;
  fmt::print(stderr, "{:3.0f} % {}\n", 100.0 * fraction, text);
}

}  // namespace palpate::cli
