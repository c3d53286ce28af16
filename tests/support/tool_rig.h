// For tests of rigid tools: tools, a surface to feel them on, and a judge of their ways.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "server/haptics/cell_cache.h"
#include "server/haptics/tool/tool_step.h"
#include "server/lab/proxy_judges.h"
#include "tests/support/made_volume.h"
#include "tests/support/tick_rig.h"

namespace palpate::testing {

// Balls in a line along z, the first at the origin.
inline RigidTool Rod(int balls, double length_mm, double rotation_length_mm = 30.0) {
  RigidTool tool;
  tool.count = balls;
  tool.radius_count = 1;
  tool.rotation_length_mm = rotation_length_mm;
  for (int n = 1; n < balls; ++n) {
    tool.ball[n].p_SBall_mm = Vec3(0.0, 0.0, length_mm * n / (balls - 1));
  }
  return tool;
}

inline Eigen::Quaterniond Turn(double angle_rad, const Vec3& axis) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, axis.normalized()));
}

// Free above z = 0; D's origin is in the middle.
inline PlacedVolume PlaceFloor() {
  constexpr int kSize = 40;
  PlacedVolume placed;
  placed.volume =
      MakeVolume(Vec3i::Constant(kSize), [](int, int, int k) { return static_cast<double>(-k); });
  placed.surface =
      MakeHapticSurface(*placed.volume, {Mat3::Identity(), Vec3::Constant(-0.5 * (kSize - 1))}, 0.5,
                        DecompositionMethod::kTpbcc, 1);
  return placed;
}

// All balls are points.
struct ToolRig {
  ToolRig(const HapticSurface& felt, const RigidTool& held) : surface(felt), tool(held) {}

  ToolStep Step(const ToolPose& stylus, ToolPath* path = nullptr) {
    return StepTool(tool, {.surface = {&surface}, .cache = {cache.get()}}, stylus, eject_limit_mm,
                    work, state, path);
  }

  HapticSurface surface;
  RigidTool tool;
  double eject_limit_mm = std::numeric_limits<double>::infinity();
  int work = kLeastToolWork;
  ToolState state;
  std::unique_ptr<ToolCellCache> cache = std::make_unique<ToolCellCache>();
};

}  // namespace palpate::testing
