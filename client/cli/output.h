// Output of the program: to stdout and the terminal, and the progress of long calls.
//
// Threads: main only.
#pragma once

#include <chrono>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>

#include "client/program/interrupt.h"
#include "client/sdk/progress.h"

namespace palpate::cli {

// Ends the program quietly. The reader of our output has closed it, as after `| head`, or a signal
// arrived while the reader did not read.
class OutputClosed : public std::runtime_error {
 public:
  OutputClosed() : std::runtime_error("the output was closed") {}
};

// Writes to stdout at once. Call it with SIGPIPE ignored.
// Errors: OutputClosed; Error with kInternal if the output cannot be written.
void WriteOutput(std::string_view text);

// True if stdout or stderr is a terminal that understands cursor movements.
bool IsTerminal(int file_descriptor);

// A line on stderr that is rewritten in place. Does nothing if stderr is not a terminal. The
// destructor clears the line.
class StatusLine {
 public:
  StatusLine();
  ~StatusLine() { Clear(); }
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;
  void Show(const std::string& text);
  void Clear();

 private:
  const bool is_terminal_;
  bool drawn_ = false;
};

struct TerminalSize {
  int columns = 80;
  int rows = 24;
};

// The size of the terminal behind stdout or stderr; 80 x 24 if the terminal does not tell its size.
TerminalSize SizeOfTerminal(int file_descriptor);

// Shows the progress of a long call on stderr.
//
// On a terminal: a bar in place, removed at the end. Otherwise: a line every 2 s.
class ProgressPrinter {
 public:
  using Clock = std::chrono::steady_clock;

  // now: tests pass their own clock.
  explicit ProgressPrinter(std::function<Clock::time_point()> now = Clock::now);
  ~ProgressPrinter();
  ProgressPrinter(const ProgressPrinter&) = delete;
  ProgressPrinter& operator=(const ProgressPrinter&) = delete;

  // `fraction`: of the whole, 0 to 1.
  void Print(std::string_view stage, double fraction, std::string_view detail = {});

 private:
  const bool is_terminal_;
  const std::function<Clock::time_point()> now_;
  bool bar_drawn_ = false;
  Clock::time_point last_line_;
};

// Runs call(progress), such as Calls::LoadVolume, and shows its progress. Ctrl-C, SIGTERM and
// SIGHUP cancel the call.
template <class Call>
auto WithProgress(const Call& call) {
  const Interrupt interrupt;
  ProgressPrinter printer;
  return call(client::ProgressFunction([&printer](const client::Progress& progress) {
    if (!progress.stage.empty()) printer.Print(progress.stage, progress.fraction, progress.detail);
    return !Interrupt::IsRaised();
  }));
}

}  // namespace palpate::cli
