#include "server/pump/last_tick.h"

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

}  // namespace palpate
