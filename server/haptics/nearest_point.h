// The point of H that is nearest to a point in free space.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation; bounded by the cells
// within reach, (2 kMaxNearestVoxels + 1)³.
#pragma once

#include <optional>

#include "server/haptics/cell_cache.h"

namespace palpate {

// How far is looked at most, in shortest voxel edges.
inline constexpr int kMaxNearestVoxels = 5;

// Nothing where H is farther than `reach_mm` or kMaxNearestVoxels.
std::optional<Vec3> NearestPointOnSurface(const HapticSurface& surface, const Vec3& p_D,
                                          double reach_mm, CellCache& cache) noexcept;

}  // namespace palpate
