// Computes one tick, without the device and the clock. The servo thread uses it, and so does code
// that computes recorded ticks again.
//
// Frame: D (mm, N, N mm). Threads: one. Real-time: no lock, no allocation, no system call.
#pragma once

#include <cstdint>
#include <string_view>

#include "server/device/haptic_device.h"
#include "server/felt/scene.h"
#include "server/haptics/renderer.h"
#include "server/haptics/tool/tool_memory.h"
#include "server/pump/tick_sample.h"
#include "server/safety/safety.h"

namespace palpate {

inline constexpr double kTickPeriodS = 1e-3;
// The most work of a tool in a tick: at its worst about half a millisecond. Several hands would
// share it.
inline constexpr int kToolWork = kLeastToolWork;

// What a device read, in D. Members as in DeviceState.
struct HandInput {
  Vec3 p_DHip_mm = Vec3::Zero();
  Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;
  bool docked = false;
  bool calibrated = true;
  Vec3 p_DLed_mm = kNowhere;
};

struct TickInput {
  HandInput stylus{};
  DeviceStatus device = DeviceStatus::kOk;
  ForceCommand command = ForceCommand::kNone;
  Vec3 push_D_n = kNowhere;        // the force of a try of the motors; kNowhere: none
  std::uint64_t missed_ticks = 0;  // in total
};

// The device's data at the servo's rate. Values that the device does not give are the Omni's.
PassivityDevice PassivityDeviceOf(const DeviceDescription& spec);

class TickComputation {
 public:
  explicit TickComputation(const SafetyLimits& limits, const PassivityDevice& device = {})
      : safety_(limits) {
    renderer_.device = device;
    renderer_.glides = true;
  }

  // Returns the sample without its times and without SCP_V (server/pump/pose_of.h). `scene` must stay
  // valid until Run returns.
  TickSample Run(const Scene& scene, const TickInput& input) noexcept;

  // Returns the input that gave `sample`, if this computation is at the sample's tick. Details that
  // a sample does not record (such as which NaN) do not change the result.
  TickInput InputOf(const TickSample& sample) const noexcept;

  // The number of the next tick.
  std::uint64_t next_tick() const { return ticks_; }
  // Nothing was felt in the last tick, for another reason than a push.
  bool was_suspended() const { return safety_.memory().was_suspended && !was_pushed_; }
  ServoKeyframe Keyframe() const noexcept;
  // Continues from `keyframe`. If the next tick's volume has no place for the proxy, the proxy
  // starts anew. Returns false, and changes nothing, if the bytes are no keyframe of this version.
  bool Resume(std::string_view keyframe) noexcept;

 private:
  Safety safety_;
  RendererState renderer_;
  ToolMemory tool_;
  bool resumed_ = false;     // resumed, and no tick since
  bool was_pushed_ = false;  // and nothing else suspended, in the last tick
  std::uint64_t ticks_ = 0;
  std::uint64_t missed_ticks_ = 0;
  std::uint64_t capped_ticks_ = 0;
  std::uint64_t faulty_ticks_ = 0;
};

}  // namespace palpate
