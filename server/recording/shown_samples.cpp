#include "server/recording/shown_samples.h"

#include <algorithm>

namespace palpate {

TickSample ShownSamples::Shown(const TickSample& live) {
  const std::uint64_t live_ms = live.tick + live.missed_ticks;
  const std::lock_guard lock(mutex_);
  const std::uint64_t since_ms = live_ms_ ? live_ms - *live_ms_ : 0;
  live_ms_ = live_ms;
  // The position never passes the last sample: if the disk is too slow, the replay waits.
  position_ms_ = std::min(position_ms_ + speed_ * static_cast<double>(since_ms), end_ms_);
  while (!waiting_.empty() && waiting_.front().position_ms <= position_ms_ &&
         waiting_.front().sample.settings_revision <= scene_) {
    current_ = waiting_.front().sample;
    waiting_.pop_front();
    ++passed_;
  }
  if (!current_) return live;
  TickSample shown = *current_;
  shown.tick = live.tick;
  shown.time_ns = live.time_ns;
  shown.scene_revision = live.scene_revision;
  shown.settings_revision = first_revision_ + scene_;
  shown.volume_revision = volume_revision_;
  shown.missed_ticks = live.missed_ticks;
  shown.capped_ticks = live.capped_ticks;
  shown.faulty_ticks = live.faulty_ticks;
  shown.force_state = live.force_state;
  shown.force_reason = live.force_reason;
  shown.force_limit_n = live.force_limit_n;
  shown.torque_limit_n_mm = live.torque_limit_n_mm;
  shown.replayed = true;
  return shown;
}

void ShownSamples::SetScene(std::uint64_t number, std::uint64_t first_revision,
                            std::uint64_t volume_revision) {
  const std::lock_guard lock(mutex_);
  scene_ = number;
  first_revision_ = first_revision;
  volume_revision_ = volume_revision;
}

void ShownSamples::Add(const TickSample& sample, double position_ms) {
  const std::lock_guard lock(mutex_);
  waiting_.push_back({position_ms, sample});
  end_ms_ = position_ms;
}

double ShownSamples::position_ms() const {
  const std::lock_guard lock(mutex_);
  return position_ms_;
}

std::size_t ShownSamples::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size();
}

std::uint64_t ShownSamples::passed() const {
  const std::lock_guard lock(mutex_);
  return passed_;
}

}  // namespace palpate
