// Euler characteristic of the trilinear isosurface V = {F = τ}, counted without
// any decomposition, from the critical points of F.
//
// V is closed: it bounds the solid M = {F > τ}, so that χ(V) = 2 χ(M). M grows as
// the level falls from the largest density to τ; it changes at critical points p
// of F alone, by 1 - χ(upper link of p), the upper link being what of a small
// sphere around p lies above F(p). With p
//   a lattice vertex: F - F(p) is to first order linear in each octant, so that
//     the upper link is that part of the octahedron of the six neighbours which
//     the higher ones span;
//   a face saddle: by the slope of F into the two cells at the face. Both up: an
//     annulus, +1. Both down: two disks, -1. One of each: a disk, 0;
//   a body saddle: its Hessian has a zero trace. One positive eigenvalue
//     (determinant above 0): two disks, -1. Two: an annulus, +1.
// Elsewhere F is monotone along some direction: along an edge it is linear, and no
// two densities are equal (ties.h). Saddles are judged by wide_saddles.h, not by the
// code that decomposes.
//
// Threads: any ordinary thread; works on all cores. Errors: Error.
#pragma once

#include <cstdint>

#include "server/lab/mesh.h"
#include "server/volume/snapshot.h"

namespace palpate::lab {

struct MorseCount {
  std::int64_t vertices = 0;      // lattice vertices that contribute
  std::int64_t face_saddles = 0;  // likewise
  std::int64_t body_saddles = 0;  // likewise
  std::int64_t solid = 0;         // χ of the side of V that does not touch the border
  std::int64_t surface() const { return 2 * solid; }  // χ(V)
};

// Of the resolved densities in `range`, whose border must lie wholly on one side
// of the isovalue (normalised), as that of PaddedCells does for isovalues of 0
// and more; kInvalidArgument otherwise.
MorseCount CountTrilinearTopology(const VolumeSnapshot& volume, double isovalue,
                                  const CellRange& range);

}  // namespace palpate::lab
