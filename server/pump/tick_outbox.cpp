#include "server/pump/tick_outbox.h"

#include <thread>

namespace palpate {

void LastTickBoard::Tell(const TickSample& sample) noexcept {
  const bool same_forces = last_ && last_->forces.state == sample.force_state &&
                           last_->forces.reason == sample.force_reason;
  if (!last_ || last_->scene_revision != sample.scene_revision) {
    scene_uses.TryPush({sample.scene_revision, sample.tick, sample.time_ns});
  }
  last_ = {.tick = sample.tick,
           .time_ns = sample.time_ns,
           .forces = {sample.force_state, sample.force_reason, sample.force_limit_n,
                      sample.torque_limit_n_mm},
           .forces_since_tick = same_forces ? last_->forces_since_tick : sample.tick,
           .stop_tick = sample.force_command == ForceCommand::kStop ? sample.tick
                        : last_                                     ? last_->stop_tick
                                                                    : 0,
           .scene_revision = sample.scene_revision};
  told_.Write(last_);
  told_to_stop_.Write(last_);
}

void LastTickBoard::TellEnd() noexcept {
  if (!last_) return;
  last_->ended = true;
  if (last_->forces.state != ForceState::kStopped) {
    last_->forces.state = ForceState::kOff;
    last_->forces.reason = ForceReason::kOperator;
    last_->forces_since_tick = last_->tick + 1;
  }
  told_.Write(last_);
  told_to_stop_.Write(last_);
}

std::optional<LastTick> LastTickBoard::newest() const {
  const std::lock_guard lock(readers_);
  return told_.Read();
}

std::optional<ForceTick> ForceWatch::newest() const {
  const std::optional<LastTick> last = board_.newest();
  if (!last) return std::nullopt;
  return ForceTick{last->tick, last->forces, last->forces_since_tick, last->ended};
}

std::optional<ForceTick> ForceWatch::WaitForTick(std::uint64_t tick,
                                                 std::chrono::milliseconds timeout) const {
  const auto end = std::chrono::steady_clock::now() + timeout;
  while (true) {
    // Read the clock before the tick: a thread that lost its core then checks once more.
    const bool is_last = std::chrono::steady_clock::now() >= end;
    const std::optional<ForceTick> now = newest();
    if (now && (now->ended || now->tick >= tick)) return now;
    if (is_last) return std::nullopt;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace palpate
