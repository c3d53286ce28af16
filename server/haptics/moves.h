// Single moves of a point through the tetrahedra and cells that hold it.
//
// Frame: D axes (mm) for directions; places in index coordinates.
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/cone.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/place.h"

namespace palpate {

// A way on from a place: a tetrahedron or free cell that holds it, and the best
// direction within.
struct Candidate {
  enum class Kind : std::uint8_t { kNone, kOutside, kBox, kTetrahedron };

  Kind kind = Kind::kNone;
  Vec3i cell = Vec3i::Zero();
  std::uint8_t faces = 0;  // of `cell`, that hold the point
  Carrier carrier;         // kTetrahedron: with the vertex numbers of `cell`
  int tetrahedron = 0;
  Vec3 d_mm = Vec3::Zero();    // move that remains to be done, at full length
  bool along_surface = false;  // d lies in H
  bool full = false;           // d is the whole of what was asked for
};

// Linear functions on a tetrahedron: what the paper's A⁻¹ holds (Eqs. 8-10).
struct TetrahedronGradients {
  std::array<Vec3, 4> weight;  // of the barycentric coordinates, 1/mm, in D axes
  Vec3 density;                // of the density

  TetrahedronGradients(const HapticCell& cell, int tetrahedron);
};

// The longest projection of `w_mm` on the tangent cones of all tetrahedra and
// free cells that hold the place; on H (`on_surface`) directions into the object
// are excluded.
Candidate BestDirection(const HapticSurface& surface, const Place& place, bool on_surface,
                        const Vec3& w_mm, CellCache& cache) noexcept;

// The steepest way down the density.
Candidate SteepestDescent(const HapticSurface& surface, const Place& place,
                          CellCache& cache) noexcept;

// Follows a kTetrahedron candidate to a face, to the end of d, or to H:
// `descending` false: from below, where the density rises to τ; true: from
// above, where it falls to τ. Sets on_surface. False where rounding allows no move.
bool MoveInTetrahedron(const HapticSurface& surface, const Candidate& candidate, bool descending,
                       Place& place, bool& on_surface, CellCache& cache) noexcept;

// Follows a kBox candidate to a face of the cell or the end of d.
void MoveInBox(const HapticSurface& surface, const Candidate& candidate, Place& place) noexcept;

// Follows a kOutside candidate, which leaves the padded lattice for good, to
// target_I.
void MoveOut(const HapticSurface& surface, const Candidate& candidate, const Vec3& target_I,
             Place& place) noexcept;

// From outside the padded lattice straight to target_I, or to where the way there
// enters the lattice.
void MoveOutside(const HapticSurface& surface, const Vec3& target_I, Place& place) noexcept;

// The place of an index position. Sets `density`; above τ, the place is a
// simplex all the same.
Place PlaceAt(const HapticSurface& surface, const Vec3& p_I, CellCache& cache,
              double& density) noexcept;

// Density and position of a place.
double PlaceDensity(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept;
Vec3 PlacePosition(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept;

}  // namespace palpate
