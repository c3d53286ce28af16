// A device without hardware that plays a recorded path of the stylus, for example of a real hand,
// and ignores the force. It repeats the recorded positions, orientations and buttons, one state per
// millisecond.
//
// It plays to the end, then backwards to the beginning, and so on, so that the stylus never jumps
// if the path is smooth.
//
// Frame: M, as the path. Threads, real-time and ownership: as HapticDevice. Call Start and Stop
// only while the servo does not run. The same path and times give the same bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/device/haptic_device.h"

namespace palpate {

// As the simulated device's spec, with another name.
DeviceDescription ReplayDeviceSpec();

class ReplayDevice final : public HapticDevice {
 public:
  // `path`: one state per millisecond. Throws Error (kInvalidArgument) if it is empty, if a state
  // is not finite, or if an orientation is no unit quaternion.
  explicit ReplayDevice(std::vector<DeviceState> path);

  const DeviceDescription& spec() const override { return spec_; }
  // Starts from the first state.
  void Start() override;
  void Stop() noexcept override { started_ = false; }

  // kFault before Start and after Stop.
  DeviceStatus Read(DeviceState& state) noexcept override;
  // Moves on by dt_s, whatever the force. Above 20 ms, moves on by 20 ms, as the simulated device
  // does.
  void Write(const DeviceCommand& command, double dt_s) noexcept override;

  // The last Write. Call it on the servo thread, or while the servo does not run.
  const DeviceCommand& last() const { return last_; }

 private:
  DeviceDescription spec_;
  std::vector<DeviceState> path_;
  std::int64_t round_ns_ = 0;  // duration of the path, there and back
  std::int64_t time_ns_ = 0;   // within the round
  bool started_ = false;
  DeviceCommand last_;
};

}  // namespace palpate
