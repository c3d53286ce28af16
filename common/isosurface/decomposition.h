// Decomposes a cell into tetrahedra. The piecewise-linear level set of the tetrahedra is the haptic
// isosurface H. Two methods:
//
// kTpbcc, the default: H has the topology of the trilinear isosurface V for every
//   τ. Our correction of Corenthy et al., section 3.4.
// kBcc (section 3.2): face and cell centres, 24 tetrahedra. Neighbours agree, so
//   the proxy cannot fall through, but the topology of H may differ from V's.
//
// Each face is split into 4 triangles around its face vertex. The split depends only on the 4
// densities of the face, so neighbours have the same triangles, bit for bit.
//
// Frame: index coordinates local to the cell.
// Threads: pure functions. Real-time: no allocation, no locks; bounded.
#pragma once

#include <array>

#include "common/contract/enumerations.h"
#include "common/isosurface/cell.h"
#include "common/isosurface/complex.h"

namespace palpate {

struct Decomposition {
  TetrahedralComplex complex;
  // Valid for the vertices in complex.used_vertices.
  std::array<Vec3, kMaxVertices> position;
  std::array<double, kMaxVertices> density;
  // True: kDiamondComplexes[0], with every vertex at its place in kPlainPositions.
  bool is_plain = false;
  // For statistics: the counts that selected the case.
  int face_saddle_count = 0;
  int body_saddle_count = 0;
};

// The corners, and the centres of the faces.
inline constexpr std::array<std::array<double, 3>, kFirstInteriorVertex> kPlainPositions = [] {
  std::array<std::array<double, 3>, kFirstInteriorVertex> places{};
  for (int v = 0; v < kFirstInteriorVertex; ++v) {
    for (int axis = 0; axis < 3; ++axis) {
      const int on = kVertexFaces[v] >> (2 * axis) & 3;
      places[v][axis] = on ? on >> 1 : 0.5;
    }
  }
  return places;
}();

// `d` must be finite and without ties (ties.h). `out`: as Decompose left it, or new.
void Decompose(const CellDensities& d, DecompositionMethod method, Decomposition& out);
inline Decomposition Decompose(const CellDensities& d, DecompositionMethod method) {
  Decomposition out;
  Decompose(d, method, out);
  return out;
}

}  // namespace palpate
