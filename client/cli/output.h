// Output of the program.
//
// Threads: main only.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

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

}  // namespace palpate::cli
