// Says what the safety stage did with forces in the newest tick, and waits until a command has been
// taken.
//
// Reads the servo's own board, not the samples. Samples may be late, and an operator who stops
// forces must not be told that the loop stands while it runs.
// Threads: any ordinary thread. Ownership: borrows the board.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "server/pump/last_tick.h"

namespace palpate {

struct ForceTick {
  std::uint64_t tick = 0;
  ForceStatus forces{};
  // The first tick with this state and reason.
  std::uint64_t since_tick = 0;
  bool ended = false;  // the loop has ended with zero force; no tick follows
};

class ForceWatch {
 public:
  explicit ForceWatch(const LastTickBoard& board) : board_(board) {}

  // None before the first tick.
  std::optional<ForceTick> newest() const;
  // Waits for a tick with this number or a greater one, and returns the first such tick that it
  // sees; or the last one of a loop that has ended. Returns none at the timeout. Polls each
  // millisecond, because the servo wakes nobody.
  std::optional<ForceTick> WaitForTick(std::uint64_t tick, std::chrono::milliseconds timeout) const;

 private:
  const LastTickBoard& board_;
};

}  // namespace palpate
