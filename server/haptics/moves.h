// Single moves of a point through the tetrahedra and cells that hold it.
//
// Frame: D axes (mm) for directions; places in L.
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/directions.h"

namespace palpate {

// What remains after a move. kMore: look for the next move. kAtRest: no remaining direction gets
// closer. kNone: rounding allowed no move.
enum class MoveEnd : std::uint8_t { kMore, kAtRest, kNone };

// Follows a kTetrahedron candidate to a face, to the end of d, or to H, which it meets from within
// free space. With `out_to`, it comes from beyond that bound, and meets only that one. Sets
// `contact`.
MoveEnd MoveInTetrahedron(const HapticSurface& surface, const Candidate& candidate, Contact out_to,
                          Place& place, Contact& contact, CellCache& cache) noexcept;

// Brings a place on a bound to the other side of the bound, which its simplex must reach: by no
// more than rounding. Returns false, and changes nothing, if it cannot.
bool CrossBound(const HapticSurface& surface, Contact bound, Place& place,
                CellCache& cache) noexcept;

// Follows a kBox candidate to a face of the cell or the end of d. If the whole voxel cell
// is free, follows it to a face of the voxel cell.
void MoveInBox(const HapticSurface& surface, const Candidate& candidate, Place& place,
               CellCache& cache) noexcept;

// Follows a kOutside candidate, which leaves the padded lattice and does not return, to target_L.
void MoveOut(const HapticSurface& surface, const Candidate& candidate, const Vec3& target_L,
             Place& place) noexcept;

// Moves from outside of the padded lattice straight to target_L, or to the point where that line
// enters the lattice.
void MoveOutside(const HapticSurface& surface, const Vec3& target_L, Place& place) noexcept;

}  // namespace palpate
