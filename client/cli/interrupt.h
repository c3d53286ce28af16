// Ctrl-C and SIGTERM as a flag, for commands that end in an orderly way.
#pragma once

namespace palpate::cli {

// While one exists, the first SIGINT and the first SIGTERM only raise a flag and
// interrupt blocking calls; a second one ends the process as usual.
// Threads: constructed and destroyed on main; IsRaised anywhere. One at a time.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  static bool IsRaised();
};

}  // namespace palpate::cli
