// Judges a rigid tool by positions alone: whether its balls came along free ways, and whether it
// rests where nothing free is nearer. Shares nothing with the tool's steps: evaluates the
// decomposed volume afresh (fresh_cells.h).
//
// Frame: D (mm). All balls are points. Threads: one per object.
#pragma once

#include <random>

#include "server/haptics/tool/tool_step.h"
#include "server/lab/fresh_cells.h"

namespace palpate::lab {

inline Vec3 BallAt(const RigidTool& tool, const ToolPose& pose, int ball) {
  return pose.p_DS_mm + pose.R_DS * tool.ball[static_cast<std::size_t>(ball)].p_SBall_mm;
}

class ToolJudge {
 public:
  // Of each chord, so many points are looked at.
  static constexpr int kPoints = 16;

  // Borrows both.
  ToolJudge(const HapticSurface& surface, const RigidTool& tool) : cells_(surface), tool_(tool) {}

  // The points of the chords between two poses that are not in free space.
  int Falls(const ToolPose& from, const ToolPose& to);
  // Of a step from `from`.
  int Falls(const ToolPose& from, const ToolPath& path);
  long judged() const { return judged_; }

  // How much nearer to the stylus a random search of free ways brings the tool, in the metric of
  // the coupling (mm). Ways that gain less than twice the tool's standoff do not count: they live
  // on the standoff.
  double NearerBySearch(std::mt19937_64& random, const ToolPose& rest, const ToolPose& stylus);

  // The distance in the metric of the coupling.
  double Distance(const ToolPose& pose, const ToolPose& stylus) const;

 private:
  bool IsFree(const Vec3& p_mm);
  bool IsFreeWay(const ToolPose& from, const ToolPose& to);

  FreshCells cells_;
  const RigidTool& tool_;
  long judged_ = 0;
};

}  // namespace palpate::lab
