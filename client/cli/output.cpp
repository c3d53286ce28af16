#include "client/cli/output.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "client/program/interrupt.h"
#include "common/error/error.h"
#include "common/error/one_line.h"

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

}  // namespace palpate::cli
