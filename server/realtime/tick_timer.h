// Wakes a thread on a fixed grid of deadlines, and counts missed deadlines.
//
// Times: ns of CLOCK_MONOTONIC.
// Threads: one, the ticking thread.
// Real-time: WaitForNext neither locks nor allocates; it sleeps in
// clock_nanosleep until shortly before the deadline and spins for the rest.
#pragma once

#include <chrono>
#include <cstdint>

namespace palpate {

// The present time on the clock of the ticks. Any thread, real-time safe.
std::int64_t MonotonicNowNs() noexcept;

struct TickTime {
  std::int64_t scheduled_ns = 0;  // the deadline that this tick belongs to
  std::int64_t started_ns = 0;    // start of the tick: scheduled_ns <= started_ns < + period
  std::uint64_t missed = 0;       // deadlines without a tick so far, in total
};

class TickTimer {
 public:
  // Waking from sleep takes about 20 us, sometimes more. Spinning over the last 50 us hides this
  // delay and costs some 5 % of a core.
  static constexpr std::chrono::nanoseconds kDefaultSpin{50'000};

  // Throws Error if the period is not positive or the spin negative.
  explicit TickTimer(std::chrono::nanoseconds period, std::chrono::nanoseconds spin = kDefaultSpin);

  // Waits for the next deadline. The first call starts the grid: its deadline is one period away.
  // If a thread comes late by one or more whole periods, it ticks at once for the newest passed
  // deadline, and the other deadlines count as missed. The phase is kept: at every return, ticks +
  // missed = (scheduled_ns - start of the grid) / period, exactly.
  TickTime WaitForNext() noexcept;

 private:
  std::int64_t period_ns_;
  std::int64_t spin_ns_;
  std::int64_t next_ns_ = 0;  // 0: the grid has not started
  std::uint64_t missed_ = 0;
};

}  // namespace palpate
