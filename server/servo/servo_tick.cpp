#include "server/servo/servo_tick.h"

#include <utility>

namespace palpate {
namespace {

// M is D.
HandInput InD(const DeviceState& stylus) {
  return {.p_DHip_mm = stylus.p_MHip_mm,
          .R_DS = stylus.R_MS,
          .buttons = stylus.buttons,
          .docked = stylus.docked,
          .calibrated = stylus.calibrated,
          .p_DLed_mm = stylus.p_MLed_mm};
}

}  // namespace

TickSample ServoTick::Run(const Scene& scene, const TickTime& time) noexcept {
  TickInput input{.missed_ticks = time.missed};
  input.device = device_.Read(stylus_);
  input.stylus = InD(stylus_);
  if (forces_ != nullptr) input.command = forces_->Take();
  if (pushes_ != nullptr)
    input.push_D_n = pushes_->Next(forces_act_, time.missed - std::exchange(missed_, time.missed));
  const std::int64_t before_ns = MonotonicNowNs();
  TickSample sample = computation_.Run(scene, input);
  sample.update_ns = MonotonicNowNs() - before_ns;
  sample.time_ns = time.started_ns;
  const bool enabled =
      sample.force_state == ForceState::kRampIn || sample.force_state == ForceState::kOn;
  forces_act_ = enabled && !computation_.was_suspended();
  const Wrench wrench{Vec3(sample.force_n.data()), Vec3(sample.torque_n_mm.data())};
  // The stylus's stop buttons have no other way to the device's own motions.
  const bool is_stopped = sample.force_state == ForceState::kStopped;
  if (is_stopped && !std::exchange(was_stopped_, is_stopped)) device_.StopMoving();
  was_stopped_ = is_stopped;
  device_.Write({.wrench_M = wrench, .motors_on = enabled || !wrench.is_zero()}, kTickPeriodS);
  return sample;
}

}  // namespace palpate
