// Counts, over a replay, the errors that a user who feels H must never meet.
//
// The judge uses only positions and a fresh decomposition of each cell. It counts:
// - Fall-through: the density at SCP_H is above τ by more than kDensityTolerance, or no path
//   through free space leads from the last SCP_H to this one (free_path.h).
// - Stick: a resting proxy is not at a local minimum (rest_judge.h). Friction holds proxies on
//   purpose, so sticks are not judged if friction is set.
// - Excess force: the spring force is above 2 k d + 0.05 N. k is the stiffness, d the distance of
//   the HIP to H.
// Ejecting ticks are counted separately. After a pop, the other side of τ is the object, and paths
// are searched only from the pop on.
//
// Threads: the calling one. Errors: none.
#pragma once

#include <optional>
#include <vector>

#include "server/lab/replay.h"
#include "server/lab/triangle_grid.h"

namespace palpate::lab {

inline constexpr double kDensityTolerance = 1e-9;  // of the range
inline constexpr double kExcessFactor = 2.0;
inline constexpr double kExcessForceN = 0.05;
// How far SCP_V may be off V, in voxels. Where F is flat, kDensityTolerance applies instead.
inline constexpr double kVisualToleranceVoxels = 1e-6;

struct Verdict {
  std::vector<double> density;  // at SCP_H of each tick, data units; NaN without a proxy
  int contact_ticks = 0;
  int ejecting_ticks = 0;
  int rejected_ticks = 0;
  int iteration_cap_hits = 0;
  int fall_throughs = 0;
  std::optional<int> sticks = 0;  // empty: not judged
  int excess_force_ticks = 0;
  // The part of excess_force_ticks whose proxy is not at rest in a local minimum. Counted only if
  // sticks are judged.
  int excess_off_minimum_ticks = 0;
  int unchecked_ticks = 0;  // the path through free space was too long to search
  int scp_v_ticks = 0;      // in contact, with SCP_V
  int scp_v_off_ticks = 0;  // the part of scp_v_ticks with SCP_V off V
  // Sums over scp_v_ticks: the distance from SCP_H to SCP_V, and the angle from the spring's force
  // (without force shading) to V's normal at SCP_V.
  double scp_hv_voxels = 0.0;
  double force_angle_deg = 0.0;
};

Verdict JudgeReplay(const HapticSurface& surface, const HapticSettings& settings,
                    const TriangleGrid& surface_triangles, const std::vector<ReplayTick>& ticks);

}  // namespace palpate::lab
