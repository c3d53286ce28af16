#include "server/servo/servo_tick.h"

namespace palpate {

TickSample ServoTick::Run(const Scene& scene, const TickTime& time) noexcept {
  TickInput input{.stylus = stylus_, .missed_ticks = time.missed};
  input.device = device_.Read(input.stylus);
  if (forces_ != nullptr) input.command = forces_->Take();
  stylus_ = input.stylus;
  const std::int64_t before_ns = MonotonicNowNs();
  TickSample sample = computation_.Run(scene, input);
  sample.update_ns = MonotonicNowNs() - before_ns;
  sample.time_ns = time.started_ns;
  const bool enabled = sample.force_state == ForceState::kRampIn ||
                       sample.force_state == ForceState::kOn;
  const Vec3 force_D_n(sample.force_n.data());
  device_.SetMotors(enabled || !force_D_n.isZero());
  device_.Write(force_D_n, kTickPeriodS);
  return sample;
}

}  // namespace palpate
