// Kinematics of the Novint Falcon: a delta mechanism of three equal arms, 120° apart.
//
// Each arm moves in its own plane. It has a thigh (60 mm), which its motor turns, a knee, and a
// parallelogram (102.5 mm) between two short links (11.25 mm each), which holds the grip. The grip
// never turns. The grip is therefore on a torus around each knee:
//   (distance to the knee in the arm's plane - 22.5)² + (offset from the plane)² = 102.5²
//
// Frames: M (mm, x right, y up, z towards the user). Its origin is on the base's axis, 125 mm in
// front of the base: the middle of the 75 to 175 mm that libnifalcon uses.
// Angles of the thighs in rad: 0 along the base, greater outwards. Torques of the thighs in N mm. A
// ball of 50 mm around the origin is within reach; the corners of the datasheet's cube are not.
// Threads: pure functions. Real-time: no allocation, bounded.
// Source: lengths, angles, encoders and motor scale as in libnifalcon (BSD), FalconGeometry.h,
// FalconKinematic.h, FalconKinematicStamper.cpp, after R. E. Stamper's thesis. We have not checked
// them on hardware. Apart for its tests.
#pragma once

#include <array>
#include <cstdint>
#include <numbers>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr double kFalconBaseToOriginMm = 125.0;

// The motor shaft's encoder has 320 slots of four edges each. The motor's drum of 14.25 mm drives
// the thigh's drum of 110 mm.
inline constexpr double kFalconDrumRatio = 14.25 / 110.0;
inline constexpr double kFalconRadPerCount =
    2.0 * std::numbers::pi / (4.0 * 320.0) * kFalconDrumRatio;
inline constexpr double kFalconAngleAtZeroRad = 35.0 * std::numbers::pi / 180.0;

// A positive count folds the thigh in. libnifalcon takes its forces for newtons. No measurement is
// published, so forces may be off by a factor.
inline constexpr double kFalconMotorCountsPerNmm = -10.0;
// The firmware's range is not documented. In the whole ball, 3.3 N needs no more than this.
inline constexpr int kFalconMotorLimit = 4096;

// Angles of the thighs from counts since the homed zero, and the nearest counts to angles.
Vec3 FalconAnglesFromCounts(const std::array<std::int16_t, 3>& counts);
std::array<std::int16_t, 3> FalconCountsFromAngles(const Vec3& angles_rad);

// Computes the angles that hold the grip at a position, with the knees outside: the arms cannot
// fold the other way. Returns false, and sets nothing, if the position is out of reach.
bool FalconAnglesAt(const Vec3& p_M_mm, Vec3& angles_rad);

// Computes the position of the grip. Returns false, and sets nothing, if no position has these
// angles.
bool FalconPositionAt(const Vec3& angles_rad, Vec3& p_M_mm);

// Computes the position's derivative by the angles, in mm per rad. Returns false where an arm could
// fold either way.
bool FalconJacobianAt(const Vec3& p_M_mm, const Vec3& angles_rad, Mat3& jacobian);

// Motor counts for torques. If a count exceeds the limit, all are scaled down, so that the force
// keeps its direction. Returns zero for torques that are not finite.
std::array<std::int16_t, 3> FalconMotorsFromTorques(const Vec3& torques_n_mm);

}  // namespace palpate
