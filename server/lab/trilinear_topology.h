// Counts the Euler characteristic of the trilinear isosurface V = {F = τ} from the critical points
// of F, without any decomposition.
//
// V is closed: it bounds the solid M = {F > τ}, so χ(V) = 2 χ(M). M grows as the level falls from
// the largest density to τ. M changes only at critical points p of F, by 1 - χ(upper link of p).
// The upper link is the part of a small sphere around p that lies above F(p). There are three kinds
// of p:
//   a lattice vertex: to first order, F - F(p) is linear in each octant. The upper link is the part
//   of the octahedron of the six neighbours that is spanned by the higher neighbours.
//   a face saddle: the slopes of F into the two cells at the face decide. Both up: an annulus, +1.
//   Both down: two disks, -1. One of each: a disk, 0.
//   a body saddle: its Hessian has a zero trace. One positive eigenvalue (determinant above 0): two
//   disks, -1. Two: an annulus, +1.
// Elsewhere F is monotone along some direction: along an edge F is linear, and no two densities are
// equal (cell.h). Its source judges the saddles itself, in quadruple precision, so the count does
// not depend on the code that decomposes.
//
// Threads: any ordinary thread; works on all cores. Errors: Error. Apart for its tests.
#pragma once

#include <cstdint>

#include "server/lab/mesh.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {

struct MorseCount {
  std::int64_t vertices = 0;      // lattice vertices that change χ
  std::int64_t face_saddles = 0;  // face saddles that change χ
  std::int64_t body_saddles = 0;  // body saddles that change χ
  std::int64_t solid = 0;         // χ of the side of V that does not touch the border
  std::int64_t surface() const { return 2 * solid; }  // χ(V)
};

// Counts over the resolved densities in `range`. The border of the range must lie completely on one
// side of the isovalue (normalised), otherwise throws kInvalidArgument. The border of PaddedCells
// does so for isovalues of 0 and more.
MorseCount CountTrilinearTopology(const VolumeSnapshot& volume, double isovalue,
                                  const CellRange& range);

}  // namespace palpate::lab
