// Kinematics of the Novint Falcon: a delta mechanism of three equal arms, 120° apart.
//
// Each arm, in a plane of its own: a thigh (60 mm) that its motor turns, a knee, a
// parallelogram (102.5 mm) between two short links (11.25 mm each), and the grip, which
// never turns. So the grip is on a torus around each knee:
//   (distance to the knee in the arm's plane - 22.5)² + (offset from the plane)² = 102.5²
//
// Frames: D (mm, x right, y up, z towards the user). Its origin is on the base's axis,
// 125 mm in front of the base: the middle of the 75 to 175 mm that libnifalcon uses.
// Angles in rad: of the thighs, 0 along the base, greater outwards; torques in N mm,
// of the thighs. A ball of 50 mm around the origin is within reach; the corners of
// the datasheet's cube are not.
// Threads: pure functions. Real-time: no allocation, bounded.
// Source: lengths, angles, encoders and the scale of the motors as in libnifalcon (BSD),
// FalconGeometry.h, FalconKinematic.h, FalconKinematicStamper.cpp, after R. E. Stamper's
// thesis; not seen on hardware by us.
#pragma once

#include <array>
#include <cstdint>
#include <numbers>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr double kFalconBaseToOriginMm = 125.0;

// Four edges for each of 320 slots, on the motor's shaft; its drum of 14.25 mm drives
// the thigh's of 110 mm.
inline constexpr double kFalconDrumRatio = 14.25 / 110.0;
inline constexpr double kFalconRadPerCount =
    2.0 * std::numbers::pi / (4.0 * 320.0) * kFalconDrumRatio;
inline constexpr double kFalconAngleAtZeroRad = 35.0 * std::numbers::pi / 180.0;

// A positive count folds the thigh in. libnifalcon takes its forces for newtons;
// nobody publishes a measurement, so that forces may be off by a factor.
inline constexpr double kFalconMotorCountsPerNmm = -10.0;
// No document says what the firmware takes. 3.3 N needs no more in all of the ball.
inline constexpr int kFalconMotorLimit = 4096;

// Angles of the thighs from counts since the homed zero, and the nearest counts.
Vec3 FalconAnglesFromCounts(const std::array<std::int16_t, 3>& counts);
std::array<std::int16_t, 3> FalconCountsFromAngles(const Vec3& angles_rad);

// The angles that hold the grip at a position; of the two ways, the one with the knees
// outside, which is the arms' only one. False, and nothing is set, out of reach.
bool FalconAnglesAt(const Vec3& p_D_mm, Vec3& angles_rad);

// The position of the grip. False, and nothing is set, for angles that no position has.
bool FalconPositionAt(const Vec3& angles_rad, Vec3& p_D_mm);

// Its derivative, mm per rad. False where the arms could fold either way.
bool FalconJacobianAt(const Vec3& p_D_mm, const Vec3& angles_rad, Mat3& jacobian);

// Counts for torques; all are scaled down where one is beyond the limit, so that the
// force keeps its direction. Zero for torques that are not finite.
std::array<std::int16_t, 3> FalconMotorsFromTorques(const Vec3& torques_n_mm);

}  // namespace palpate
