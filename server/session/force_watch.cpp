#include "server/session/force_watch.h"

namespace palpate {

void ForceWatch::OnSample(const TickSample& sample) {
  {
    const std::lock_guard lock(mutex_);
    const bool same =
        newest_ && newest_->state == sample.force_state && newest_->reason == sample.force_reason;
    newest_ = {sample.tick, sample.force_state, sample.force_reason, sample.force_limit_n,
               same ? newest_->since_tick : sample.tick};
  }
  // Without a waiter this is no system call.
  seen_.notify_all();
}

std::optional<ForceTick> ForceWatch::newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

std::optional<ForceTick> ForceWatch::WaitForTick(std::uint64_t tick,
                                                 std::chrono::milliseconds timeout) const {
  std::unique_lock lock(mutex_);
  if (!seen_.wait_for(lock, timeout, [&] { return newest_ && newest_->tick >= tick; })) {
    return std::nullopt;
  }
  return newest_;
}

}  // namespace palpate
