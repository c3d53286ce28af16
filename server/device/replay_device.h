// A device without hardware that plays a recorded path of the stylus, such as one of a
// real hand, whatever is felt: the same positions, orientations and buttons, one a
// millisecond.
//
// It plays to the end, then backwards to the beginning, and so on, so that the stylus
// never jumps where the path was smooth.
//
// Frame: D, as the path. Threads, real-time and ownership: as HapticDevice; Start and
// Stop not while the servo runs. The same path and times give the same bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/device/haptic_device.h"

namespace palpate {

// As the simulated device's, but for its name.
DeviceSpec ReplayDeviceSpec();

class ReplayDevice final : public HapticDevice {
 public:
  // One state a millisecond. Throws Error (kInvalidArgument) if there is none, or if
  // one is not finite or its orientation is no unit quaternion.
  explicit ReplayDevice(std::vector<DeviceState> path);

  const DeviceSpec& spec() const override { return spec_; }
  // From the first state on.
  void Start() override;
  void Stop() noexcept override { started_ = false; }

  // kFault before Start and after Stop.
  DeviceStatus Read(DeviceState& state) noexcept override;
  // Goes on by the time, whatever the force. A time above 20 ms goes on by 20 ms, as
  // the simulated device's.
  void Write(const Vec3& force_D_n, double dt_s) noexcept override;

  // Of the last Write. Servo thread, or while it does not run.
  const Vec3& last_force_D_n() const { return last_force_D_n_; }

 private:
  DeviceSpec spec_;
  std::vector<DeviceState> path_;
  std::int64_t round_ns_ = 0;  // there and back
  std::int64_t time_ns_ = 0;   // within it
  bool started_ = false;
  Vec3 last_force_D_n_ = Vec3::Zero();
};

}  // namespace palpate
