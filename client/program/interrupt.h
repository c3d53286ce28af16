// Ctrl-C, SIGTERM and SIGHUP as a flag, for programs that end in order.
#pragma once

namespace palpate {

// While an object exists, the first SIGINT, SIGTERM or SIGHUP only sets a flag and interrupts
// blocking calls. A second signal of the same kind ends the process as usual.
// Threads: construct and destroy on main; call IsRaised on any. One object at a time.
class Interrupt {
 public:
  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  static bool IsRaised();
};

}  // namespace palpate
