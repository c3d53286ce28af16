// How a point moves through the tetrahedra and cells that hold it: the directions in which it can
// move, and single moves.
//
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/cone.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/place.h"

namespace palpate {

// Finds the direction in which a point can move: examines the tetrahedra and free cells that hold
// the point.
//
// Frame: D axes (mm) for directions; places in L.
//
// A possible move from a place: a tetrahedron or free cell that holds the place, and the best
// direction within it.
struct Candidate {
  enum class Kind : std::uint8_t { kNone, kOutside, kBox, kTetrahedron };

  Kind kind = Kind::kNone;
  Vec3i cell = Vec3i::Zero();
  std::uint8_t faces = 0;  // faces of `cell` that hold the point
  // kBox, kTetrahedron: the cell; valid until the cache fills its slot anew.
  HapticCell* entry = nullptr;
  // kTetrahedron.
  Carrier carrier;  // with the vertex numbers of `cell`
  int tetrahedron = 0;
  Vec3 d_mm = Vec3::Zero();    // the remaining move, at full length
  bool along_surface = false;  // d lies in H, on which the place rests
  bool full = false;           // d is the whole requested move
};

// Returns the longest projection of `w_mm` on the tangent cones of all tetrahedra and free cells
// that hold the place. On H, directions across the bound that it rests on (`contact`) are excluded.
// `held`: the place's cell in `cache`, decomposed, if the caller has it; its slot was not filled
// anew since. Adds the number of examined tetrahedra to `tetrahedra`.
Candidate BestDirection(const HapticSurface& surface, const Place& place, HapticCell* held,
                        Contact contact, const Vec3& w_mm, CellCache& cache,
                        int& tetrahedra) noexcept;

// Returns the direction in which the density falls most steeply, or, towards the lower bound,
// rises.
Candidate SteepestWay(const HapticSurface& surface, const Place& place, Contact towards,
                      CellCache& cache) noexcept;

// Single moves of a point through the tetrahedra and cells that hold it.
//
// Frame: D axes (mm) for directions; places in L.
// Threads: pure functions. Real-time: no allocation, bounded.

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
