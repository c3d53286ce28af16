#include "server/lab/orientation.h"

#include <bit>

#include "common/geometry/geometry.h"

namespace palpate::lab {
namespace {

// Corners and face vertices get their own positions, all other vertices the cell's centre.
Vec3 ReferencePosition(int v) {
  Vec3 p = Vec3::Constant(0.5);
  for (int axis = 0; axis < 3; ++axis) {
    const int sides = kVertexFaces[v] >> (2 * axis) & 3;
    if (sides != 0) p[axis] = sides == 2 ? 1.0 : 0.0;
  }
  return p;
}

// If three vertices lie in one face of the cell, the tetrahedron lies on the inner side of this
// face, wherever its fourth vertex is. Returns 0 if there is no such face.
int SignAtBorder(const std::array<std::uint8_t, 4>& vertices) {
  for (int apex = 0; apex < 4; ++apex) {
    unsigned faces = 0x3F;
    for (int n = 0; n < 4; ++n) {
      if (n != apex) faces &= kVertexFaces[vertices[n]];
    }
    if (faces == 0) continue;
    Vec3 p[4];
    for (int n = 0; n < 4; ++n) {
      p[n] = n == apex ? Vec3(Vec3::Constant(0.5)) : ReferencePosition(vertices[n]);
    }
    Mat3 m;
    for (int n = 0; n < 3; ++n) m.col(n) = p[n + 1] - p[0];
    return m.determinant() > 0.0 ? 1 : -1;
  }
  return 0;
}

// Derives the sign of tetrahedron `t` from the sign of `known`. The two share a triangle and lie on
// opposite sides of it.
int SignAcross(const TetrahedralComplex& complex, int t, int known, int known_sign) {
  const auto& from = complex.vertices[known];
  std::array<int, 4> place;  // places in `known` of t's vertices
  for (int n = 0; n < 4; ++n) {
    const int v = complex.vertices[t][n];
    const bool is_shared = complex.vertex_mask[known] >> v & 1;
    for (int m = 0; m < 4; ++m) {
      // t's own vertex takes the place of known's own vertex.
      if (is_shared ? from[m] == v : !(complex.vertex_mask[t] >> from[m] & 1)) place[n] = m;
    }
  }
  return -known_sign * PermutationSign(place);
}

}  // namespace

TetrahedronSigns SignsOf(const TetrahedralComplex& complex) {
  TetrahedronSigns signs{};
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    signs[t] = SignAtBorder(complex.vertices[t]);
  }
  for (bool found = true; found;) {
    found = false;
    for (int t = 0; t < complex.tetrahedron_count; ++t) {
      for (int known = 0; known < complex.tetrahedron_count && signs[t] == 0; ++known) {
        const unsigned shared = complex.vertex_mask[t] & complex.vertex_mask[known];
        if (signs[known] == 0 || std::popcount(shared) != 3) continue;
        signs[t] = SignAcross(complex, t, known, signs[known]);
        found = true;
      }
    }
  }
  return signs;
}

}  // namespace palpate::lab
