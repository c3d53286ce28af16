// The last stage before the device. Whatever was computed, the force and the torque on the hand are
// finite, within the device's limits and gradual, and they are there only while they may be.
//
// What is said of the force below holds for the torque, too, by limits of its own. Each is clamped
// by itself: a great torque does not weaken the force. Both are cut in the same tick. A device
// without motors for torque gets none, and its orientation is not judged.
//
// Each tick checks, in this order:
//
//   fault           bad device, position, orientation, force or torque, or faster than a hand: zero
//                   at once
//   zero at once    stopped, suspended, docked, uncalibrated
//   ramped to zero  stale readings, missed deadlines
//   norm clamp      to the device's greatest force
//   thermal limit   from the greatest force towards the continuous one
//   ramp-in         after forces were enabled
//   slew limit      the change of the force per tick
//
// At the end the device's Stop writes zero frames before it releases the device.
//
// Its states:
//
//            enable                     ramp ended
//     kOff ----------> kRampIn ----------------------------> kOn
//      ^ disable        | ^ nothing is missing any more       |
//      | (from any)     v |                                   |
//      |               kHeld <--------------------------------+  docked, uncalibrated,
//      |                |  \                                  |  stale, deadlines
//      |                v   \                                 |
//      +------------- kFault <--------------------------------+  device, position, force,
//      |                | enable, and the fault has passed    |  speed
//      |                | (a simulated device: by itself)     |
//      |                +-----------> kRampIn                 |
//      |                                                      |
//      +------------ kStopped <-------------------------------+  stop: from any state
//                       | enable -> kRampIn
//
// The thermal limit comes before the slew limit, so that a falling limit is gradual on the hand,
// too.
//
// kOff, kHeld: the force falls to zero by the slew limit, within RampOutTicks. If the stylus is
// docked or uncalibrated, the force is zero in the same tick. kFault, kStopped: the force is zero
// in the same tick. Only enable and stop lead out of kOff: without forces there are no faults of
// forces.
//
// Frame: D (mm, N, N mm). Threads: one. Real-time: no allocation, no locks; every function
// is bounded. Same inputs, same bits out.
#pragma once

#include <cstdint>

#include "common/contract/enumerations.h"
#include "common/geometry/wrench.h"
#include "server/device/haptic_device.h"

namespace palpate {

struct SafetyLimits {
  double max_force_n = 3.3;
  // 0.2 N per ms: a stroke at 10 cm/s and 0.5 N/mm needs 0.05.
  double max_slew_n_per_s = 200.0;
  double max_torque_n_mm = 0.0;                // 0: no torque
  double max_torque_slew_n_mm_per_s = 3000.0;  // from 0 to 50 in 17 ms, as 3.3 N by 200 N/s
  // The limits below protect motors and hands. For a simulated device they are off (0, false).
  double ramp_in_s = 0.0;
  double continuous_force_n = 0.0;      // 0: no thermal limit
  double continuous_torque_n_mm = 0.0;  // 0: no thermal limit
  double thermal_time_s = 0.0;          // in which motors warm up and cool down
  double max_speed_mm_per_s = 0.0;      // 0: no limit
  double max_turn_rad_per_s = 0.0;      // 0: no limit
  double max_missed_ticks = 0.0;        // beyond one of twenty; 0: no limit
  bool faults_stay = false;             // a fault stays until forces are enabled again
  bool starts_on = true;                // forces are on without being enabled
  std::uint32_t stop_buttons = 0;       // all held together: stop; 0: none

  bool operator==(const SafetyLimits&) const = default;
};

// The limits of a device. A device with motors has all of them. `stop_buttons`: as in SafetyLimits.
SafetyLimits LimitsFor(const DeviceDescription& spec, std::uint32_t stop_buttons);

// The number of ticks in which any force and torque falls to zero by the slew limits.
int RampOutTicks(const SafetyLimits& limits, double dt_s);

// The input of one tick.
struct SafetyInput {
  Wrench wrench_D{};
  Vec3 p_DHip_mm = Vec3::Zero();
  Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();
  DeviceStatus device = DeviceStatus::kOk;
  bool docked = false;
  bool calibrated = true;
  bool position_rejected = false;
  // Nothing is felt now: zero at once, and no fault. After more than one such tick in a row the
  // force comes back by a ramp, on every device.
  bool suspended = false;
  // The force is a try of the motors. After it, too, the force comes back by a ramp.
  bool pushed = false;
  std::uint32_t buttons = 0;
  ForceCommand command = ForceCommand::kNone;
  std::uint64_t missed_ticks = 0;  // since the last tick
};

// The state from which the next tick starts.
struct SafetyMemory {
  ForceState state = ForceState::kOff;
  ForceReason reason = ForceReason::kOperator;
  Wrench last_D{};
  double ramp_s = 0.0;     // since the ramp-in began
  double ramp_in_s = 0.0;  // its length
  bool was_suspended = false;
  bool resumes = false;     // suspended for more than a tick; the next force begins a ramp
  double heat_n2 = 0.0;     // low-passed square of the force
  double heat_n_mm2 = 0.0;  // of the torque
  bool has_hip = false;
  Vec3 p_DHip_mm = Vec3::Zero();
  double hip_age_s = 0.0;
  Vec3 velocity_mm_per_s = Vec3::Zero();                     // low-passed
  Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();  // valid with has_hip
  double turn_rad_per_s = 0.0;                               // low-passed
  double missed_ticks = 0.0;                                 // beyond one of twenty
};

class Safety {
 public:
  explicit Safety(const SafetyLimits& limits);

  // Returns the force and torque to write. `dt_s`: the period of the loop.
  Wrench Step(const SafetyInput& input, double dt_s) noexcept;

  ForceState state() const { return memory_.state; }
  ForceReason reason() const { return memory_.reason; }
  // True if the last tick had a fault, or if a fault stays.
  bool faulty() const { return faulty_; }
  // The greatest force that the motors' warmth allows now.
  double limit_n() const noexcept;
  double torque_limit_n_mm() const noexcept;

  const SafetyMemory& memory() const { return memory_; }
  void Resume(const SafetyMemory& memory) noexcept { memory_ = memory; }

 private:
  void Follow(const SafetyInput& input, double elapsed_s) noexcept;
  ForceReason FaultOf(const SafetyInput& input) const noexcept;
  ForceReason HoldOf(const SafetyInput& input) const noexcept;
  void Obey(const SafetyInput& input) noexcept;
  void Enter(ForceState state, ForceReason reason) noexcept;
  void Change(ForceReason fault, ForceReason hold) noexcept;
  void FollowSuspension(bool suspended) noexcept;
  void StepTo(const Wrench& wanted_D, double dt_s) noexcept;
  double Share(double dt_s) noexcept;
  bool turns() const { return limits_.max_torque_n_mm > 0.0; }

  SafetyLimits limits_;
  SafetyMemory memory_;
  bool faulty_ = false;
};

}  // namespace palpate
