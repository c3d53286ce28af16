// The tetrahedra of a decomposed cell, as vertex numbers.
//
// Vertices are numbered 0-7 corners, 8-13 face vertices (8 + face), 14 and 15
// interior vertices.
//
// Threads: plain values. Real-time: no allocation, no locks.
#pragma once

#include <array>
#include <cstdint>

#include "common/isosurface/cell.h"

namespace palpate {

inline constexpr int kFirstFaceVertex = 8;
inline constexpr int kFirstInteriorVertex = 14;
inline constexpr int kMaxVertices = 16;
inline constexpr int kMaxTetrahedra = 30;

struct TetrahedralComplex {
  int tetrahedron_count = 0;
  std::array<std::array<std::uint8_t, 4>, kMaxTetrahedra> vertices{};
  std::array<std::uint16_t, kMaxTetrahedra> vertex_mask{};  // bit n: vertex n
  std::uint16_t used_vertices = 0;                          // vertices of all tetrahedra, likewise
  std::array<std::uint32_t, kMaxVertices> tetrahedra_at{};  // bit t: tetrahedron t has the vertex

  constexpr void Add(int a, int b, int c, int d) {
    const int n = tetrahedron_count++;
    const int corner[4] = {a, b, c, d};
    for (int v = 0; v < 4; ++v) {
      vertices[n][v] = static_cast<std::uint8_t>(corner[v]);
      vertex_mask[n] |= static_cast<std::uint16_t>(1u << corner[v]);
      tetrahedra_at[corner[v]] |= std::uint32_t{1} << n;
    }
    used_vertices |= vertex_mask[n];
  }

  // Joins `apex` to the 4 triangles around the vertex of a face.
  constexpr void AddFacePyramid(int apex, int face) {
    const auto& corners = kFaceCorners[face];
    for (int n = 0; n < 4; ++n) {
      Add(apex, kFirstFaceVertex + face, corners[n], corners[(n + 1) % 4]);
    }
  }
};

// The faces of the cell on which a vertex lies: bit 2 * axis + side.
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

// The 12 edges of the cube, as pairs of corners.
inline constexpr std::array<std::array<std::uint8_t, 2>, 12> kCubeEdges = [] {
  std::array<std::array<std::uint8_t, 2>, 12> edges{};
  int count = 0;
  for (int u = 0; u < 8; ++u) {
    for (int axis = 0; axis < 3; ++axis) {
      auto o = kCornerOffset[u];
      if (o[axis] == 1) continue;
      o[axis] = 1;
      edges[count++] = {static_cast<std::uint8_t>(u),
                        static_cast<std::uint8_t>(CornerAt(o[0], o[1], o[2]))};
    }
  }
  return edges;
}();

// The corner diagonally across the cell.
constexpr int OppositeCorner(int corner) {
  const auto& o = kCornerOffset[corner];
  return CornerAt(1 - o[0], 1 - o[1], 1 - o[2]);
}

// Complex with one interior vertex, joined to all 24 boundary triangles.
constexpr TetrahedralComplex MakeSingleComplex() {
  TetrahedralComplex complex;
  for (int face = 0; face < 6; ++face) complex.AddFacePyramid(kFirstInteriorVertex, face);
  return complex;
}

// Complex with two interior vertices. The first serves the three faces at `corner`, the second the
// other faces. The 6 cube edges that touch neither `corner` nor its opposite are joined to both.
constexpr TetrahedralComplex MakeDoubleComplex(int corner) {
  const int a = kFirstInteriorVertex, b = a + 1;
  TetrahedralComplex complex;
  for (int face = 0; face < 6; ++face) {
    complex.AddFacePyramid(kVertexFaces[corner] >> face & 1 ? a : b, face);
  }
  const int opposite = OppositeCorner(corner);
  for (const auto& [u, v] : kCubeEdges) {
    if (u == corner || v == corner || u == opposite || v == opposite) continue;
    complex.Add(a, b, u, v);
  }
  return complex;
}

inline constexpr TetrahedralComplex kSingleComplex = MakeSingleComplex();
inline constexpr std::array<TetrahedralComplex, 8> kDoubleComplexes = [] {
  std::array<TetrahedralComplex, 8> complexes{};
  for (int corner = 0; corner < 8; ++corner) complexes[corner] = MakeDoubleComplex(corner);
  return complexes;
}();

}  // namespace palpate
