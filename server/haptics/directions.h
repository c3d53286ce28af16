// Finds the direction in which a point can move: examines the tetrahedra and free cells that hold
// the point.
//
// Frame: D axes (mm) for directions; places in L.
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/cone.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/place.h"

namespace palpate {

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

}  // namespace palpate
