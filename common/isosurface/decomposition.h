// Decomposition of a cell into tetrahedra, whose piecewise-linear level set is
// the haptic isosurface H.
//
// Vertices are numbered 0-7 corners, 8-13 face vertices (8 + face), 14 and 15
// interior vertices. Each face is split into 4 triangles around its face
// vertex, which depends on the 4 densities of the face alone; neighbours thus
// share these triangles bit for bit.
//
// kBcc: face and cell centres (Corenthy et al., section 3.2); the topology of H
// may differ from that of the trilinear isosurface V.
// kTpbcc: our correction of section 3.4; H has the topology of V for every τ.
//   1. No body saddle: one interior vertex with a density strictly between the
//      last joining and the first splitting face saddle.
//   2. At most four face saddles and a body saddle: one interior vertex with the
//      body saddle's density.
//   3. Six face saddles in the order JJSJSS: two interior vertices, one for the
//      faces at each of two opposite corners.
// Densities decide the topology, so that vertices are placed for shape: within
// [0.3, 0.7] of their face or cell, which keeps needles out.
//
// Frame: index coordinates local to the cell.
// Threads: pure functions. Real-time: no allocation, no locks; bounded.
#pragma once

#include <array>
#include <cstdint>

#include "common/isosurface/cell.h"

namespace palpate {

enum class DecompositionMethod : std::uint8_t { kBcc, kTpbcc };

inline constexpr int kFirstFaceVertex = 8;
inline constexpr int kFirstInteriorVertex = 14;
inline constexpr int kMaxVertices = 16;
inline constexpr int kMaxTetrahedra = 30;

// The tetrahedra alone; one of a few constant tables.
struct TetrahedralComplex {
  int tetrahedron_count = 0;
  int vertex_count = 0;  // 15 or 16
  std::array<std::array<std::uint8_t, 4>, kMaxTetrahedra> vertices{};
  std::array<std::uint16_t, kMaxTetrahedra> vertex_mask{};  // bit n: vertex n
};

struct Decomposition {
  const TetrahedralComplex* complex = nullptr;  // static storage
  std::array<Vec3, kMaxVertices> position;
  std::array<double, kMaxVertices> density;
  // What decided, for statistics.
  int face_saddle_count = 0;
  int body_saddle_count = 0;  // -1: not looked for
};

// `d` resolved (ties.h) and finite.
Decomposition Decompose(const CellDensities& d, DecompositionMethod method);

// Faces of the cell on which a vertex lies, bit 2 * axis + side.
inline constexpr std::array<std::uint8_t, kMaxVertices> kVertexFaces = [] {
  std::array<std::uint8_t, kMaxVertices> faces{};
  for (int v = 0; v < 8; ++v) {
    for (int axis = 0; axis < 3; ++axis) {
      faces[v] |= static_cast<std::uint8_t>(1u << (2 * axis + kCornerOffset[v][axis]));
    }
  }
  for (int face = 0; face < 6; ++face) {
    faces[kFirstFaceVertex + face] = static_cast<std::uint8_t>(1u << face);
  }
  return faces;
}();

}  // namespace palpate
