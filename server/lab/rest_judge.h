// Judges whether a resting proxy is right: of all free points next to it, it must be the nearest to
// the HIP.
//
// The judge does not use the proxy's cones. The free part of every tetrahedron that holds the proxy
// is convex. So the proxy is a local minimum of its distance to the HIP exactly if none of these
// parts has a point nearer to the HIP.
//
// Frame: D (mm). Threads: one per FreshCells. Errors: none.
#pragma once

#include "server/lab/fresh_cells.h"

namespace palpate::lab {

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

}  // namespace palpate::lab
