#include "server/servo/servo_tick.h"

namespace palpate {

ServoTick::ServoTick(HapticDevice& device)
    : device_(device), computation_(device.spec().max_force_n) {}

TickSample ServoTick::Run(const Scene& scene, const TickTime& time) noexcept {
  TickInput input{.stylus = stylus_, .missed_ticks = time.missed};
  input.device_ok = device_.Read(input.stylus) == DeviceStatus::kOk;
  stylus_ = input.stylus;
  const std::int64_t before_ns = MonotonicNowNs();
  TickSample sample = computation_.Run(scene, input);
  sample.update_ns = MonotonicNowNs() - before_ns;
  sample.time_ns = time.started_ns;
  device_.Write(Vec3(sample.force_n.data()), kTickPeriodS);
  return sample;
}

}  // namespace palpate
