// Which way a point can go on: the tetrahedra and free cells that hold it.
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

// The longest projection of `w_mm` on the tangent cones of all tetrahedra and
// free cells that hold the place; on H (`on_surface`) directions into the object
// are excluded. Adds the tetrahedra looked at to `tetrahedra`.
Candidate BestDirection(const HapticSurface& surface, const Place& place, bool on_surface,
                        const Vec3& w_mm, CellCache& cache, int& tetrahedra) noexcept;

// The steepest way down the density.
Candidate SteepestDescent(const HapticSurface& surface, const Place& place,
                          CellCache& cache) noexcept;

}  // namespace palpate
