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
#include <cstdint>
#include <utility>

#include "common/contract/enumerations.h"
#include "common/isosurface/cell.h"

namespace palpate {

inline constexpr int kFirstFaceVertex = 8;
inline constexpr int kFirstInteriorVertex = 14;
inline constexpr int kMaxVertices = 16;
inline constexpr int kMaxTetrahedra = 30;

// The tetrahedra of a decomposed cell, as vertex numbers.
//
// Vertices: 0 to 7 corners, 8 to 13 of faces (8 + face), 14 and 15 in the inside.
//
// Threads: plain values. Real-time: no allocation, no locks.
struct TetrahedralComplex {
  int tetrahedron_count = 0;
  std::array<std::array<std::uint8_t, 4>, kMaxTetrahedra> vertices{};
  std::array<std::uint16_t, kMaxTetrahedra> vertex_mask{};  // bit n: vertex n
  std::uint16_t used_vertices = 0;                          // vertices of all tetrahedra, likewise
  std::array<std::uint32_t, kMaxVertices> tetrahedra_at{};  // bit t: tetrahedron t has the vertex

  constexpr void Add(int a, int b, int c, int d) {
    const int n = tetrahedron_count++;
    vertices[n] = {static_cast<std::uint8_t>(a), static_cast<std::uint8_t>(b),
                   static_cast<std::uint8_t>(c), static_cast<std::uint8_t>(d)};
    vertex_mask[n] = static_cast<std::uint16_t>(1u << a | 1u << b | 1u << c | 1u << d);
    used_vertices |= vertex_mask[n];
    for (const int v : {a, b, c, d}) tetrahedra_at[v] |= std::uint32_t{1} << n;
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

// Returns the face vertices of the `count` faces in the bit mask `faces`.
template <std::size_t count>
constexpr std::array<std::uint8_t, count> FaceVerticesAt(unsigned faces) {
  std::array<std::uint8_t, count> vertices{};
  for (int face = 0, n = 0; face < 6; ++face) {
    if (faces >> face & 1) vertices[n++] = static_cast<std::uint8_t>(kFirstFaceVertex + face);
  }
  return vertices;
}

// An edge of the cube: its corners, u at the lower end, and the vertices of its faces.
struct CubeEdge {
  std::uint8_t u, v, f, g;
};
inline constexpr std::array<CubeEdge, 12> kCubeEdges = [] {
  std::array<CubeEdge, 12> edges{};
  int count = 0;
  for (int u = 0; u < 8; ++u) {
    for (int axis = 0; axis < 3; ++axis) {
      auto o = kCornerOffset[u];
      if (o[axis] == 1) continue;
      o[axis] = 1;
      const int v = CornerAt(o[0], o[1], o[2]);
      auto [f, g] = FaceVerticesAt<2>(kVertexFaces[u] & kVertexFaces[v]);
      // (u, v, f, g) is in positive order.
      if ((o[0] + o[1] + o[2] + axis) % 2 == 1) std::swap(f, g);
      edges[count++] = {static_cast<std::uint8_t>(u), static_cast<std::uint8_t>(v), f, g};
    }
  }
  return edges;
}();

// The vertices of the three faces at each corner: in positive order behind the corner.
inline constexpr std::array<std::array<std::uint8_t, 3>, 8> kFacesAtCorner = [] {
  std::array<std::array<std::uint8_t, 3>, 8> faces{};
  for (int corner = 0; corner < 8; ++corner) {
    const auto& o = kCornerOffset[corner];
    faces[corner] = FaceVerticesAt<3>(kVertexFaces[corner]);
    if ((o[0] + o[1] + o[2]) % 2 == 1) std::swap(faces[corner][0], faces[corner][1]);
  }
  return faces;
}();

// Complex with one interior vertex O, joined to all 24 boundary triangles, and then flipped:
// - at the cube edges in `edges`: two tetrahedra around the triangle of O and the edge become three
//   around a new edge between the vertices of the edge's faces
// - at the corners in `corners`, whose three edges must be flipped: three tetrahedra around the
//   edge from O to the corner become two, with a new triangle of the three face vertices between
// All tetrahedra are in positive order: det(b - a, c - a, d - a) > 0.
constexpr TetrahedralComplex MakeFlippedComplex(unsigned edges, unsigned corners) {
  constexpr int o = kFirstInteriorVertex;
  TetrahedralComplex complex;
  for (std::size_t n = 0; n < kCubeEdges.size(); ++n) {
    const auto& [u, v, f, g] = kCubeEdges[n];
    if (!(edges >> n & 1)) {
      complex.Add(o, v, u, f);
      complex.Add(o, u, v, g);
      continue;
    }
    complex.Add(u, v, f, g);
    if (!(corners >> u & 1)) complex.Add(u, o, g, f);
    if (!(corners >> v & 1)) complex.Add(o, v, g, f);
  }
  for (int corner = 0; corner < 8; ++corner) {
    if (!(corners >> corner & 1)) continue;
    const auto& [f, g, h] = kFacesAtCorner[corner];
    complex.Add(corner, f, g, h);
    complex.Add(o, f, h, g);
  }
  return complex;
}

// Complex without an interior vertex: all edges and corners are flipped, and the octahedron of the
// face vertices is cut around its diagonal along `axis`. 24 tetrahedra.
constexpr TetrahedralComplex MakeDiamondComplex(int axis) {
  TetrahedralComplex complex;
  for (const auto& [u, v, f, g] : kCubeEdges) complex.Add(u, v, f, g);
  for (int corner = 0; corner < 8; ++corner) {
    const auto& [f, g, h] = kFacesAtCorner[corner];
    complex.Add(corner, f, g, h);
  }
  const int low = kFirstFaceVertex + 2 * axis, high = low + 1;
  for (const auto& [u, v, f, g] : kCubeEdges) {
    const bool along = (kVertexFaces[u] ^ kVertexFaces[v]) == 3 << (2 * axis);
    if (along) complex.Add(low, high, g, f);
  }
  return complex;
}

// Complex with two interior vertices. The first serves the three faces at `corner`, the second the
// other faces. The 6 cube edges that touch neither `corner` nor its opposite are joined to both.
constexpr TetrahedralComplex MakeDoubleComplex(int corner) {
  const int a = kFirstInteriorVertex, b = a + 1;
  const auto apex = [&](int face) { return kVertexFaces[corner] >> face & 1 ? a : b; };
  TetrahedralComplex complex;
  for (int face = 0; face < 6; ++face) complex.AddFacePyramid(apex(face), face);
  for (const auto& [u, v, f, g] : kCubeEdges) {
    if (apex(f - kFirstFaceVertex) != apex(g - kFirstFaceVertex)) complex.Add(a, b, u, v);
  }
  return complex;
}

inline constexpr TetrahedralComplex kSingleComplex = MakeFlippedComplex(0, 0);
inline constexpr std::array<TetrahedralComplex, 3> kDiamondComplexes = {
    MakeDiamondComplex(0), MakeDiamondComplex(1), MakeDiamondComplex(2)};
inline constexpr std::array<TetrahedralComplex, 8> kDoubleComplexes = [] {
  std::array<TetrahedralComplex, 8> complexes{};
  for (int corner = 0; corner < 8; ++corner) complexes[corner] = MakeDoubleComplex(corner);
  return complexes;
}();

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

// `d` must be finite and without ties (cell.h). `out`: as Decompose left it, or new.
void Decompose(const CellDensities& d, DecompositionMethod method, Decomposition& out);
inline Decomposition Decompose(const CellDensities& d, DecompositionMethod method) {
  Decomposition out;
  Decompose(d, method, out);
  return out;
}

}  // namespace palpate
