// Single moves of a point through the tetrahedra and cells that hold it.
//
// Frame: D axes (mm) for directions; places in index coordinates.
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/directions.h"

namespace palpate {

// What a move leaves to be done: a look for the next one; nothing, as no
// direction is left that gets closer; nothing, as rounding allowed no move.
enum class MoveEnd : std::uint8_t { kMore, kAtRest, kNone };

// Follows a kTetrahedron candidate to a face, to the end of d, or to H:
// `descending` false: from below, where the density rises to τ; true: from
// above, where it falls to τ. Sets on_surface.
MoveEnd MoveInTetrahedron(const HapticSurface& surface, const Candidate& candidate, bool descending,
                          Place& place, bool& on_surface, CellCache& cache) noexcept;

// Follows a kBox candidate to a face of the cell or the end of d.
void MoveInBox(const HapticSurface& surface, const Candidate& candidate, Place& place,
               CellCache& cache) noexcept;

// Follows a kOutside candidate, which leaves the padded lattice for good, to
// target_I.
void MoveOut(const HapticSurface& surface, const Candidate& candidate, const Vec3& target_I,
             Place& place) noexcept;

// From outside the padded lattice straight to target_I, or to where the way there
// enters the lattice.
void MoveOutside(const HapticSurface& surface, const Vec3& target_I, Place& place) noexcept;

}  // namespace palpate
