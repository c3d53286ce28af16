// Divides a cell into refinement³ sub-cells. Within a sub-cell, F is again the trilinear
// interpolant of its corners: V stays the same, and H, made of sub-cells, comes nearer to V.
//
// A value on an edge or a face of the cell has the same bits in every cell that shares it. There,
// the other corners drop out exactly, and what is left is taken in the order of the lattice's axes.
// If all values change their sign, so does every result, exactly.
//
// Frame: steps of 1 / refinement along the cell's edges, from d0.
// Threads: pure functions. Real-time: no allocation, no locks.
#pragma once

#include "common/isosurface/cell.h"

namespace palpate {

inline constexpr int kMaxRefinement = 4;

// The corners of the sub-cell at `sub`, each of its coordinates in [0, refinement): interpolated
// along x, then y, then z. But for rounding of thirds, each value lies between those of the cell.
CellDensities SubCell(const CellDensities& d, const Vec3i& sub, int refinement);

}  // namespace palpate
