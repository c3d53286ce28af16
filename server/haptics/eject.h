// Brings a point back into free space when the surface has moved over it.
//
// Threads: pure. Real-time: no allocation; at most kMaxEjectMoves moves for each
// step of the refinement, and kMaxSearchRadius shells of voxels.
#pragma once

#include "server/haptics/moves.h"

namespace palpate {

inline constexpr int kMaxEjectMoves = 128;
inline constexpr int kMaxSearchRadius = 6;  // voxels

// Moves `place`, whose density is not that of free space, to free space. Descends the
// piecewise-linear density to the upper bound, or ascends it to the lower one. From a pit or a peak
// beyond the bound, jumps to the nearest free voxel within `limit_mm`.
// Returns false if there is none within reach; `place` is then unspecified. Sets `contact`. Adds
// the number of moves to `moves`.
bool Eject(const HapticSurface& surface, double limit_mm, Place& place, Contact& contact,
           CellCache& cache, int& moves) noexcept;

}  // namespace palpate
