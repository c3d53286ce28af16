// Judges of a proxy by positions alone: whether it came through free space, and whether it rests at
// the right place.
#pragma once

#include <random>

#include "server/haptics/tool/tool_step.h"
#include "server/lab/fresh_cells.h"

namespace palpate::lab {

enum class FreePath {
  kFound,
  kNone,       // there is no path within the ball
  kUnchecked,  // the search was cut off
};

inline constexpr int kMostPathNodes = 50'000;

// Finds out whether a proxy can have come from one position to another through free space.
//
// Searches the decomposed volume, independently of the proxy's moves. The nodes of the search are:
// - the tetrahedra of crossed cells that have a free vertex,
// - whole free cells,
// - the outside.
// Two nodes are neighbours if they share a face whose free part is not empty. Within a tick, the
// proxy's distance to the HIP never grows. So the path lies in the ball around the HIP whose
// surface holds the start, and the search enters only cells that meet this ball.
//
// Frame: D (mm). Threads: one per FreshCells. Errors: none.
FreePath FindFreePath(FreshCells& cells, const Vec3& from_mm, const Vec3& to_mm,
                      const Vec3& p_DHip_mm, int most_nodes = kMostPathNodes);

// Judges whether a resting proxy is right: of all free points next to it, it must be the nearest to
// the HIP.
//
// The judge does not use the proxy's cones. The free part of every tetrahedron that holds the proxy
// is convex. So the proxy is a local minimum of its distance to the HIP exactly if none of these
// parts has a point nearer to the HIP.
//
// Frame: D (mm). Threads: one per FreshCells. Errors: none.

// A proxy sticks if it could come nearer to the HIP by more than the largest of:
// - a share of its distance, which would turn the force by about 0.003°,
// - a share of a voxel,
// - a share of the HIP's coordinates, because positions are rounded.
inline constexpr double kStickTolerance = 1e-9;
inline constexpr double kStickTolerancePerVoxel = 1e-9;
inline constexpr double kStickTolerancePerPosition = 1e-14;

// How much nearer to the HIP the free space next to the proxy comes, in mm. Looks at the tetrahedra
// that hold the proxy within `hold_tolerance`, which is at most kHoldTolerance.
double ApproachLeft(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm,
                    double hold_tolerance = kHoldTolerance);

// True if ApproachLeft is within the tolerances.
bool IsLocalMinimum(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm);

inline Vec3 BallAt(const RigidTool& tool, const ToolPose& pose, int ball) {
  return pose.p_DS_mm + pose.R_DS * tool.ball[static_cast<std::size_t>(ball)].p_SBall_mm;
}

// Judges a rigid tool by positions alone: whether its balls came along free ways, and whether it
// rests where nothing free is nearer. Shares nothing with the tool's steps: evaluates the
// decomposed volume afresh (fresh_cells.h).
//
// Frame: D (mm). All balls are points. Threads: one per object.
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
