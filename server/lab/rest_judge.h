// Whether a resting proxy is where it should be: nearest to the HIP among all free
// points next to it.
//
// Told without the proxy's cones: the free part of every tetrahedron that holds the
// proxy is convex, so that the proxy is a local minimum of its distance to the HIP
// just where none of these parts has a point that is nearer to the HIP.
//
// Frame: D (mm). Threads: one per FreshCells. Errors: none.
#pragma once

#include "server/lab/fresh_cells.h"

namespace palpate::lab {

// A proxy sticks where it could come nearer to the HIP by more than this share of
// its distance, which would turn the force by about 0.003 °, or of a voxel, or of
// the positions themselves, which are rounded.
inline constexpr double kStickTolerance = 1e-9;
inline constexpr double kStickTolerancePerVoxel = 1e-9;
inline constexpr double kStickTolerancePerPosition = 1e-14;

// How much nearer to the HIP the free space next to the proxy comes, mm. Next to it are the
// tetrahedra that hold it: within `hold_tolerance`, at most kHoldTolerance.
double ApproachLeft(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm,
                    double hold_tolerance = kHoldTolerance);

// Nothing is left but what the tolerances allow.
bool IsLocalMinimum(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm);

}  // namespace palpate::lab
