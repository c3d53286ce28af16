// A Phantom Omni without hardware, with its workspace, forces and resolution. A virtual hand holds
// the stylus. A script leads the hand, and the device's force moves the hand.
//
// Frame D: mm, origin in the middle of the workspace; forces in N. The stylus's z axis runs from
// the tip along the barrel.
// Threads, real-time and ownership: as HapticDevice. Call Start and Stop only while the servo does
// not run. The same script, forces and times give the same bits.
#pragma once

#include <cstdint>
#include <memory>

#include "server/device/haptic_device.h"
#include "server/device/stylus_script.h"

namespace palpate {

// The spec of the simulated device, for code that needs its workspace before the device exists.
DeviceDescription SimulatedDeviceSpec();

// A longer tick moves a hand without hardware only so far, also a recorded one.
inline constexpr double kLongestMoveS = 0.02;

class SimulatedDevice final : public HapticDevice {
 public:
  // The hand starts at rest at the script's first target. Throws Error without a
  // script.
  explicit SimulatedDevice(std::unique_ptr<StylusScript> script,
                           const DeviceDescription& spec = SimulatedDeviceSpec());

  const DeviceDescription& spec() const override { return spec_; }
  void Start() override { started_ = true; }
  void Stop() noexcept override { started_ = false; }

  // Reads the hand's position, rounded down to the device's resolution. Returns kFault before Start
  // and after Stop.
  DeviceStatus Read(DeviceState& state) noexcept override;

  // Moves the hand on. A force above the peak saturates. A force that is not finite counts as zero.
  // A time above 20 ms moves the hand by 20 ms, so that a stall does not cost the servo further
  // time.
  void Write(const Vec3& force_D_n, double dt_s) noexcept override;

 private:
  void MoveHand(const Vec3& p_DTarget_mm, const Vec3& force_D_n, double dt_s);
  void StopAtWorkspace();
  void TiltStylus(double dt_s);

  DeviceDescription spec_;
  std::unique_ptr<StylusScript> script_;
  bool started_ = false;
  HandState hand_;
  Vec3 smooth_velocity_mm_s_ = Vec3::Zero();
  double sway_phase_rad_ = 0.0;
  Eigen::Quaterniond R_DS_;
  std::uint32_t buttons_ = 0;
  Vec3 p_DLed_mm_ = kNowhere;
};

}  // namespace palpate
