// One tick: reads the device, updates the haptics, writes the force, returns a sample.
//
// Threads: the servo thread only. Real-time: no lock, no allocation, no log, no wait. Only the
// device makes system calls.
#pragma once

#include <cstdint>

#include "server/device/haptic_device.h"
#include "server/felt/scene.h"
#include "server/realtime/tick_timer.h"
#include "server/servo/force_switch.h"
#include "server/servo/hand_push.h"
#include "server/servo/tick_computation.h"

namespace palpate {

class ServoTick {
 public:
  // Borrows all. `forces`: the operator's commands, or null. `pushes`: the tries of the motors, or
  // null.
  ServoTick(HapticDevice& device, const SafetyLimits& limits, ForceSwitch* forces = nullptr,
            HandPush* pushes = nullptr)
      : device_(device),
        forces_(forces),
        pushes_(pushes),
        computation_(limits, PassivityDeviceOf(device.spec())) {}
  explicit ServoTick(HapticDevice& device) : ServoTick(device, LimitsFor(device.spec(), 0)) {}

  // `scene` must stay valid until Run returns.
  TickSample Run(const Scene& scene, const TickTime& time) noexcept;

  // The number of the next tick.
  std::uint64_t next_tick() const { return computation_.next_tick(); }
  ServoKeyframe Keyframe() const noexcept { return computation_.Keyframe(); }

 private:
  HapticDevice& device_;
  ForceSwitch* forces_;
  HandPush* pushes_;
  TickComputation computation_;
  DeviceState stylus_;
  bool forces_act_ = false;  // in the last tick
  bool was_stopped_ = false;
  std::uint64_t missed_ = 0;  // ticks, before the last one
};

}  // namespace palpate
