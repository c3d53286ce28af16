// One tick: read the device, update the haptics, write the force, report.
//
// Threads: the servo thread only. Real-time: no lock, no allocation, no log, no
// wait; the only system calls are the device's.
#pragma once

#include "server/device/haptic_device.h"
#include "server/haptics/renderer.h"
#include "server/realtime/tick_timer.h"
#include "server/servo/safety.h"
#include "server/servo/scene.h"

namespace palpate {

inline constexpr double kTickPeriodS = 1e-3;

class ServoTick {
 public:
  // Borrows the device.
  explicit ServoTick(HapticDevice& device);

  // `scene` stays valid until the return.
  TickSample Run(const Scene& scene, const TickTime& time) noexcept;

 private:
  HapticDevice& device_;
  Safety safety_;
  RendererState renderer_;
  DeviceState stylus_;
  std::uint64_t ticks_ = 0;
  std::uint64_t missed_ticks_ = 0;
  std::uint64_t capped_ticks_ = 0;
  std::uint64_t faulty_ticks_ = 0;
};

}  // namespace palpate
