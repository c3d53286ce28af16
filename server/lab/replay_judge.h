// What must never happen to one who feels H, counted over a replay.
//
// Judged from positions alone, by the decomposition of each cell made afresh:
// - fall-through: the density at SCP_H is above τ by more than kDensityTolerance, or
//   SCP_H is not reached from the last one through free space (free_path.h);
// - stick: a resting proxy that is no local minimum (rest_judge.h). Friction holds
//   proxies on purpose: sticks are not judged then;
// - excess force: a spring force above 2 k d + 0.05 N, d the distance of the HIP to H.
// Ejecting ticks are apart. After a pop the other side of τ is the object's, and the
// way is judged from there on.
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
// Of SCP_V from V: of a voxel, and where V is flat, of the range.
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
  // Of those, where sticks are judged, the ones whose proxy is at rest in no local minimum.
  int excess_off_minimum_ticks = 0;
  int unchecked_ticks = 0;  // whose way through free space was too long to search
  int scp_v_ticks = 0;      // in contact, with SCP_V
  int scp_v_off_ticks = 0;  // of those, with SCP_V off V
};

Verdict JudgeReplay(const HapticSurface& surface, const HapticSettings& settings,
                    const TriangleGrid& surface_triangles, const std::vector<ReplayTick>& ticks);

}  // namespace palpate::lab
