// What the safety stage did with forces in the newest tick, for those who ask and
// those who wait for their command to have been taken.
//
// Asks the servo's own board, not the samples: those may be late, and an operator who
// stops forces is not to be told that the loop stands when it runs.
// Threads: any ordinary one. Ownership: borrows the board.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "server/samples/last_tick.h"

namespace palpate {

struct ForceTick {
  std::uint64_t tick = 0;
  ForceState state = ForceState::kOff;
  ForceReason reason = ForceReason::kOperator;
  double limit_n = 0.0;
  // First tick with this state and reason.
  std::uint64_t since_tick = 0;
};

class ForceWatch {
 public:
  explicit ForceWatch(const LastTickBoard& board) : board_(board) {}

  // None before the first tick.
  std::optional<ForceTick> newest() const;
  // The first tick seen with this number or a greater one; none when it does not come
  // in time. Looks each millisecond: the servo wakes nobody.
  std::optional<ForceTick> WaitForTick(std::uint64_t tick, std::chrono::milliseconds timeout) const;

 private:
  const LastTickBoard& board_;
};

}  // namespace palpate
