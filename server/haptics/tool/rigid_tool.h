// A rigid tool: balls on a shaft, felt on the isosurface all at once.
//
// The balls are given in the stylus's frame S. A ball is felt as its centre in the volume that was
// dilated by its radius (server/volume/snapshot/ball_field.h), so every function here knows centres
// only.
//
// Frames: S stylus, D device; mm. Threads: plain values. Real-time: no allocation; no function of
// the C library but sqrt, so the same input gives the same bits on every machine.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "common/geometry/geometry.h"

namespace palpate {

inline constexpr int kMostToolBalls = 64;
inline constexpr int kMostToolRadii = 3;

struct ToolBall {
  Vec3 p_SBall_mm = Vec3::Zero();
  std::uint8_t radius = 0;  // which of RigidTool::radius_mm

  bool operator==(const ToolBall&) const = default;
};

struct RigidTool {
  std::array<ToolBall, kMostToolBalls> ball;
  int count = 0;
  std::array<double, kMostToolRadii> radius_mm{};  // 0: a point
  int radius_count = 0;
  // ρ: a turn by an angle counts as a move by ρ times the angle. The coupling that turns the tool
  // back is ρ² times the stiffness.
  double rotation_length_mm = 30.0;

  std::span<const ToolBall> balls() const { return {ball.data(), static_cast<std::size_t>(count)}; }
};

// Where the tool is: the origin and the axes of S.
struct ToolPose {
  Vec3 p_DS_mm = Vec3::Zero();
  Eigen::Quaterniond R_DS = Eigen::Quaterniond::Identity();
};

// A small move: first turned about the origin of S by a rotation vector, then moved. D's axes.
struct ToolMove {
  Vec3 way_mm = Vec3::Zero();
  Vec3 turn_rad = Vec3::Zero();

  ToolMove operator*(double share) const { return {share * way_mm, share * turn_rad}; }
};

// The longest turn that Moved takes.
inline constexpr double kLongestTurnRad = 0.5;

ToolPose Moved(const ToolPose& pose, const ToolMove& move) noexcept;

// The move from one pose to another; its turn may be up to π.
ToolMove MoveBetween(const ToolPose& from, const ToolPose& to) noexcept;

}  // namespace palpate
