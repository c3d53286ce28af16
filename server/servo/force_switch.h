// Holds the operator's newest command for the forces. Any thread sets the command, the servo takes
// it.
//
// Threads: Set and Withdraw on any, Take on the servo thread. Real-time: Take is wait-free.
#pragma once

#include <atomic>

#include "server/safety/safety.h"

namespace palpate {

class ForceSwitch {
 public:
  // The newest command replaces the one that waits. A waiting stop is never replaced. The servo
  // takes a command within a tick.
  void Set(ForceCommand command) noexcept {
    ForceCommand waiting = command_.load();
    do {
      if (waiting == ForceCommand::kStop) return;
    } while (!command_.compare_exchange_weak(waiting, command, std::memory_order_seq_cst));
  }

  // Cancels this command if the servo has not taken it yet.
  void Withdraw(ForceCommand command) noexcept {
    command_.compare_exchange_strong(command, ForceCommand::kNone, std::memory_order_relaxed);
  }

  ForceCommand Take() noexcept {
    // A command is rare, and a load is cheaper than an exchange. In one order with the count of
    // ticks, by which who gives a command knows the tick that has it.
    if (command_.load() == ForceCommand::kNone) return ForceCommand::kNone;
    return command_.exchange(ForceCommand::kNone, std::memory_order_acquire);
  }

 private:
  std::atomic<ForceCommand> command_{ForceCommand::kNone};
};

}  // namespace palpate
