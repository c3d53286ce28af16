// The arm of a Phantom Omni: positions of the stylus from readings, and counts of the motors from
// forces (omni_frames.h). Nobody knows whether a Touch on USB sends such frames.
//
// The place of rest: the encoders count from their positions at power-on. They are zeroed while the
// stylus rests in its dock, after kOmniRestReadings equal docked readings. There the arm stands at
// kOmniDock. Every docking sets the zero anew. Before the first docking of a
// connection, and after each RequestCalibration, positions have no meaning and no force is given.
// Frame M: as in kinematics.h, without an offset.
//
// Threads: one, but RequestCalibration on any. Real-time: no locks, no allocation.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <numbers>
#include <optional>

#include "common/geometry/geometry.h"
#include "server/device/haptic_device.h"
#include "server/device/omni/omni_frames.h"

namespace palpate {

inline constexpr double kOmniLinkMm = 133.35;  // each of the two links
inline constexpr double kOmniCountsPerTurn = 15000.0;
inline constexpr double kOmniRadPerCount = 2.0 * std::numbers::pi / kOmniCountsPerTurn;

// Kinematics of the Phantom Omni / Geomagic Touch arm.
//
// Joints: the base turns about y. Shoulder and elbow are the angles of the two links. The elbow's
// angle is absolute: against the vertical, not against the first link.
// Frames: M (mm, x right, y up, z towards the user). The stylus's gimbal counts as the tip. Angles
// in rad, torques in N mm.
// Threads: pure functions. Real-time: no allocation, bounded.
// Source: link lengths and offsets from two independent open drivers. We have not checked them on
// hardware.
struct OmniJoints {
  double base_rad = 0.0;
  double shoulder_rad = 0.0;
  double elbow_rad = 0.0;
};

// How far the joints have turned while the encoders counted so. The second encoder counts down.
OmniJoints OmniJointsFromCounts(const std::array<std::int16_t, 3>& counts);

// Position of the gimbal in M. M's origin is about the middle of the stylus's reach: 168 mm in
// front of the base's axis, 23 mm below the shoulder.
Vec3 OmniPosition(const OmniJoints& joints);

// Orientation of the stylus in M. The stylus's z axis runs from the tip along the barrel. The
// gimbal's angles turn, in this order: about the second link, about the axis across link and
// barrel, about the barrel. With the three gimbal angles at 0, the barrel is perpendicular to the
// link and in the arm's plane. With all six angles at 0, the orientation is that of M.
// The order, signs and zeros of the gimbal's angles are our guess: no source has them.
Eigen::Quaterniond OmniOrientation(const OmniJoints& joints,
                                   const std::array<double, 3>& gimbal_rad);

// The derivative of the position, mm per rad; columns: base, shoulder, elbow.
Mat3 OmniJacobian(const OmniJoints& joints);

// The joint torques that put this force on the hand.
Vec3 OmniTorques_n_mm(const OmniJoints& joints, const Vec3& force_M_n);

inline constexpr int kOmniRestReadings = 50;
// The arm in the dock. Source: one public driver (raw_omni), for the same convention of angles. We
// have not checked it on hardware.
inline constexpr OmniJoints kOmniDock{.shoulder_rad = 0.23, .elbow_rad = -0.37};
// With 10, the motors saturate at 1 N with the arm stretched out.
inline constexpr double kOmniMaxMotorGain = 10.0;

// What of a device's spec is the arm's. The workspace is the data sheet's, about M's origin. All of
// it is within reach. Without motors its greatest force is 0.
DeviceDescription OmniArmSpec(bool has_motors);

class OmniArm {
 public:
  // Motor counts per N mm of torque at the base, shoulder and elbow, at most kOmniMaxMotorGain.
  // Negative if a positive count turns the joint back. Neither sizes nor signs are public. Without
  // them there is no force. Throws Error (kInvalidArgument) for other gains.
  using Gains = std::array<double, 3>;
  explicit OmniArm(const std::optional<Gains>& motor_counts_per_n_mm = {});

  // Resets the state for a new connection.
  void Forget() noexcept;

  // Whether the reading's counter follows that of the last one, within a second.
  bool Continues(const OmniState& reading) const noexcept;

  // Returns how many readings were lost before this one. None, and `state` stays: it is the last
  // frame once more. That is no new reading: a device that hangs must become stale.
  std::optional<std::uint32_t> Take(const OmniState& reading, DeviceState& state) noexcept;

  // At the last reading. Disabled and zero if forces are off, or no force can be given.
  OmniForce ForceOf(const Vec3& force_M_n, bool forces_on) const noexcept;

  void RequestCalibration() noexcept { calibration_wanted_ = true; }

 private:
  void Calibrate(const OmniState& reading) noexcept;

  std::optional<Gains> motor_counts_per_n_mm_;
  OmniJoints joints_;                   // of the last reading
  std::array<std::int16_t, 3> zero_{};  // encoders at the place of rest
  bool calibrated_ = false;
  std::array<std::int16_t, 3> docked_at_{};  // encoders of the docked readings so far
  int rest_readings_ = 0;                    // docked, with the same encoders
  std::atomic<bool> calibration_wanted_{false};
  std::optional<std::uint32_t> counter_;  // of the last reading
};

}  // namespace palpate
