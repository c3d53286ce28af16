// Brings a point out of the object when the surface has moved over it.
//
// Threads: pure. Real-time: no allocation; at most kMaxEjectMoves moves and
// kMaxSearchRadius shells of lattice vertices.
#pragma once

#include "server/haptics/moves.h"

namespace palpate {

inline constexpr int kMaxEjectMoves = 128;
inline constexpr int kMaxSearchRadius = 6;  // voxels

// Moves `place`, whose density is above τ, to free space: down the
// piecewise-linear density, and from a pit that stays above τ to the nearest
// free lattice vertex, looked for up to `limit_mm` away. False where there is none
// within reach; `place` is then unspecified. Adds the moves made to `moves`.
bool Eject(const HapticSurface& surface, double limit_mm, Place& place, bool& on_surface,
           CellCache& cache, int& moves) noexcept;

}  // namespace palpate
