// Kinematics of the Phantom Omni / Geomagic Touch arm.
//
// Joints: base turns about y; shoulder and elbow are the angles of the two links,
// the elbow's against the vertical and not against the first link (absolute).
// Frames: D (mm, x right, y up, z towards the user); the stylus's gimbal is the
// tip. Angles in rad, torques in N mm.
// Threads: pure functions. Real-time: no allocation, bounded.
// Source: link lengths and offsets as two independent open drivers have them; not
// seen on hardware by us.
#pragma once

#include <array>
#include <cstdint>
#include <numbers>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr double kOmniLinkMm = 133.35;  // of either link
inline constexpr double kOmniCountsPerTurn = 15000.0;
inline constexpr double kOmniRadPerCount = 2.0 * std::numbers::pi / kOmniCountsPerTurn;

struct OmniJoints {
  double base_rad = 0.0;
  double shoulder_rad = 0.0;
  double elbow_rad = 0.0;
};

// Encoder counts since the stylus left the dock, where all three are 0. The
// second encoder counts down.
OmniJoints OmniJointsFromCounts(const std::array<std::int16_t, 3>& counts);

// Position of the gimbal in D, whose origin is about the middle of what the stylus
// reaches: 168 mm in front of the base's axis, 23 mm below the shoulder.
Vec3 OmniPosition(const OmniJoints& joints);

// Orientation of the stylus in D; its z axis runs from the tip along the barrel. The
// gimbal's angles turn, in this order: about the second link, about the axis across
// link and barrel, about the barrel; all at 0: the barrel is square to the link, in the
// arm's plane. With all six angles at 0 it is D's own orientation.
// The angles' order, signs and zeros are our guess: no source has them.
Eigen::Quaterniond OmniOrientation(const OmniJoints& joints,
                                   const std::array<double, 3>& gimbal_rad);

// The position's derivative, mm per rad; columns: base, shoulder, elbow.
Mat3 OmniJacobian(const OmniJoints& joints);

// Torques that put a force on the hand.
Vec3 OmniTorques_n_mm(const OmniJoints& joints, const Vec3& force_D_n);

// The joints that reach a position; of the two ways, the one with the elbow up,
// which is the arm's only one. False, and nothing is set, where the links are too
// short, or the position is on the base's axis.
bool OmniJointsAt(const Vec3& p_D_mm, OmniJoints& joints);

}  // namespace palpate
