// Finds the point of H that is nearest to a point in free space.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation; bounded by the cells
// within reach, (2 kMaxNearestVoxels + 3)³.
#pragma once

#include <optional>

#include "server/haptics/cell_cache.h"

namespace palpate {

// The farthest search, in distances between the closest lattice planes.
inline constexpr int kMaxNearestVoxels = 4;

inline double MaxNearestMm(const HapticSurface& surface) {
  return kMaxNearestVoxels / surface.X_ID.linear.rowwise().norm().maxCoeff();
}

// Returns nothing if H is farther away than `reach_mm` or MaxNearestMm().
std::optional<Vec3> NearestPointOnSurface(const HapticSurface& surface, const Vec3& p_D,
                                          double reach_mm, CellCache& cache) noexcept;

}  // namespace palpate
