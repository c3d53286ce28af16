// The operator's hand on the forces: the newest command, from any thread to the servo.
//
// Threads: Set on any, Take on the servo thread. Real-time: Take is wait-free.
#pragma once

#include <atomic>

#include "server/safety/safety.h"

namespace palpate {

class ForceSwitch {
 public:
  // The newest wins, but a stop that the servo has not taken yet wins over all; it
  // takes them within a tick.
  void Set(ForceCommand command) noexcept {
    ForceCommand waiting = command_.load(std::memory_order_relaxed);
    do {
      if (waiting == ForceCommand::kStop) return;
    } while (!command_.compare_exchange_weak(waiting, command, std::memory_order_seq_cst));
  }

  // A command that the servo has not taken is not to hold any more.
  void Withdraw(ForceCommand command) noexcept {
    command_.compare_exchange_strong(command, ForceCommand::kNone, std::memory_order_relaxed);
  }

  ForceCommand Take() noexcept {
    // Nearly always there is none: a load is cheaper than an exchange.
    if (command_.load(std::memory_order_relaxed) == ForceCommand::kNone) return ForceCommand::kNone;
    return command_.exchange(ForceCommand::kNone, std::memory_order_acquire);
  }

 private:
  std::atomic<ForceCommand> command_{ForceCommand::kNone};
};

}  // namespace palpate
