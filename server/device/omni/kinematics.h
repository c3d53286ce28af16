// Kinematics of the Phantom Omni / Geomagic Touch arm.
//
// Joints: the base turns about y. Shoulder and elbow are the angles of the two links. The elbow's
// angle is absolute: against the vertical, not against the first link.
// Frames: M (mm, x right, y up, z towards the user). The stylus's gimbal counts as the tip. Angles
// in rad, torques in N mm.
// Threads: pure functions. Real-time: no allocation, bounded.
// Source: link lengths and offsets from two independent open drivers. We have not checked them on
// hardware.
#pragma once

#include <array>
#include <cstdint>
#include <numbers>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr double kOmniLinkMm = 133.35;  // each of the two links
inline constexpr double kOmniCountsPerTurn = 15000.0;
inline constexpr double kOmniRadPerCount = 2.0 * std::numbers::pi / kOmniCountsPerTurn;

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

}  // namespace palpate
