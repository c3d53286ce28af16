#include "server/realtime/tick_timer.h"

#include <time.h>

#include <cerrno>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

void SleepUntil(std::int64_t time_ns) noexcept {
  timespec time{};
  time.tv_sec = time_ns / kNsPerS;
  time.tv_nsec = time_ns % kNsPerS;
  // The time is absolute, so after a signal the same call continues the wait.
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr) == EINTR) {
  }
}

// Tells the core that this is a spin loop, which saves power and gives cycles to the sibling
// thread.
void Pause() noexcept {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace

std::int64_t MonotonicNowNs() noexcept {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * kNsPerS + now.tv_nsec;
}

TickTimer::TickTimer(std::chrono::nanoseconds period, std::chrono::nanoseconds spin)
    : period_ns_(period.count()), spin_ns_(spin.count()) {
  if (period_ns_ <= 0 || spin_ns_ < 0) {
    throw Error(ErrorKind::kInvalidArgument,
                "a tick timer needs a period above 0 ns and a spin of at least 0 ns");
  }
}

TickTime TickTimer::WaitForNext() noexcept {
  std::int64_t now_ns = MonotonicNowNs();
  if (next_ns_ == 0) next_ns_ = now_ns + period_ns_;

  if (now_ns < next_ns_ - spin_ns_) SleepUntil(next_ns_ - spin_ns_);
  while ((now_ns = MonotonicNowNs()) < next_ns_) Pause();

  // Whole periods since the deadline, after a late wake-up or a late call.
  const std::int64_t skipped = (now_ns - next_ns_) / period_ns_;
  missed_ += static_cast<std::uint64_t>(skipped);
  const std::int64_t scheduled_ns = next_ns_ + skipped * period_ns_;
  next_ns_ = scheduled_ns + period_ns_;
  return {.scheduled_ns = scheduled_ns, .started_ns = now_ns, .missed = missed_};
}

}  // namespace palpate
