// What the program writes.
//
// Threads: main only.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace palpate::cli {

// The reader of our output has gone away, as after `| head`, or a signal came
// while it did not read: a quiet end.
class OutputClosed : public std::runtime_error {
 public:
  OutputClosed() : std::runtime_error("the output was closed") {}
};

// Writes to stdout at once. Needs SIGPIPE to be ignored.
// Errors: OutputClosed; Error with kInternal when the output cannot be written.
void WriteOutput(std::string_view text);

// stdout or stderr is a terminal that understands cursor movements.
bool IsTerminal(int file_descriptor);

// One line in place on a terminal's stderr; nothing elsewhere. Its destructor clears it.
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

// Of the terminal behind stdout or stderr; 80 x 24 when it does not say.
TerminalSize SizeOfTerminal(int file_descriptor);

}  // namespace palpate::cli
