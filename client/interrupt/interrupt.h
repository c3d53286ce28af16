// Ctrl-C, SIGTERM and SIGHUP as a flag, for programs that end in order.
#pragma once

namespace palpate {

// While one exists, the first SIGINT, SIGTERM and SIGHUP only raise a flag and
// interrupt blocking calls; a second of the same ends the process as usual.
// Threads: constructed and destroyed on main; IsRaised anywhere. One at a time.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  static bool IsRaised();
};

}  // namespace palpate
