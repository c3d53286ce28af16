// A Phantom Omni without hardware, with its workspace, forces and resolution. A virtual hand holds
// the stylus. A script leads the hand, and the device's force moves the hand.
//
// Frame M: mm, origin in the middle of the workspace; forces in N. The stylus's z axis runs from
// the tip along the barrel.
// Threads, real-time and ownership: as HapticDevice. Call Start and Stop only while the servo does
// not run. The same script, forces and times give the same bits.
#pragma once

#include <cstdint>
#include <memory>

#include "server/device/haptic_device.h"
#include "server/simulated_hand/stylus_script.h"

namespace palpate {

// The spec of the simulated device, for code that needs its workspace before the device exists.
// max_torque_n_mm: 0: it has no motors for torque.
DeviceDescription SimulatedDeviceSpec(double max_torque_n_mm = 0.0);

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

  // Moves the hand on. A force or torque above its peak saturates, and one that is not finite
  // counts as zero. With motors for torque, a wrist holds the stylus as a damped spring, which the
  // torque turns; without them the stylus is turned as the hand wants. A time above 20 ms moves the
  // hand by 20 ms, so that a stall does not cost the servo further time.
  void Write(const DeviceCommand& command, double dt_s) noexcept override;

 private:
  void MoveHand(const Vec3& p_MTarget_mm, const Vec3& force_M_n, double dt_s);
  void StopAtWorkspace();
  Eigen::Quaterniond TiltedStylus(double dt_s);
  void TurnStylus(const Eigen::Quaterniond& R_MTarget, const Vec3& torque_M_n_mm, double dt_s);

  DeviceDescription spec_;
  std::unique_ptr<StylusScript> script_;
  bool started_ = false;
  HandState hand_;
  Vec3 smooth_velocity_mm_s_ = Vec3::Zero();
  double sway_phase_rad_ = 0.0;
  Eigen::Quaterniond R_MS_;
  Vec3 turn_rad_s_ = Vec3::Zero();
  std::uint32_t buttons_ = 0;
  Vec3 p_MLed_mm_ = kNowhere;
};

}  // namespace palpate
