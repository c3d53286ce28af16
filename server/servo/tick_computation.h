// What one tick computes, apart from the device and the clock: the servo thread and
// those who compute recorded ticks again share it.
//
// Frame: D (mm, N). Threads: one. Real-time: no lock, no allocation, no system call.
#pragma once

#include <cstdint>
#include <string_view>

#include "server/device/haptic_device.h"
#include "server/haptics/renderer.h"
#include "server/safety/safety.h"
#include "server/samples/servo_keyframe.h"
#include "server/samples/tick_sample.h"
#include "server/scene/scene.h"

namespace palpate {

inline constexpr double kTickPeriodS = 1e-3;

struct TickInput {
  DeviceState stylus{};
  DeviceStatus device = DeviceStatus::kOk;
  ForceCommand command = ForceCommand::kNone;
  std::uint64_t missed_ticks = 0;  // so far
};

// What a device says of itself, at the servo's rate; the Omni's numbers for what it leaves open.
PassivityDevice PassivityDeviceOf(const DeviceSpec& spec);

class TickComputation {
 public:
  explicit TickComputation(const SafetyLimits& limits, const PassivityDevice& device = {})
      : safety_(limits) {
    renderer_.device = device;
  }

  // All of the sample but its times. `scene` stays valid until the return.
  TickSample Run(const Scene& scene, const TickInput& input) noexcept;

  // The input that gave a sample, where this computation is at its tick: what a
  // sample does not tell of it (how a position was no position) makes no
  // difference.
  TickInput InputOf(const TickSample& sample) const noexcept;

  // Before the next tick.
  std::uint64_t next_tick() const { return ticks_; }
  ServoKeyframe Keyframe() const noexcept;
  // Goes on from there; a proxy where the next tick's volume has no place for it begins
  // anew. False, and nothing has changed, for bytes that are no keyframe of this version.
  bool Resume(std::string_view keyframe) noexcept;

 private:
  Safety safety_;
  RendererState renderer_;
  bool resumed_ = false;  // and not run since
  std::uint64_t ticks_ = 0;
  std::uint64_t missed_ticks_ = 0;
  std::uint64_t capped_ticks_ = 0;
  std::uint64_t faulty_ticks_ = 0;
};

}  // namespace palpate
