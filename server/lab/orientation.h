// Finds the tetrahedra of a complex that are listed in positive order.
//
// Uses only the connections between tetrahedra. Positions cannot tell: around saddles near the
// border of a cell, tetrahedra may be flat, and in kTpbccPublished inverted.
//
// Threads: pure functions.
#pragma once

#include <array>

#include "common/isosurface/complex.h"

namespace palpate::lab {

// +1 or -1 for each tetrahedron: the sign of det(b - a, c - a, d - a) for its
// vertices a, b, c, d.
using TetrahedronSigns = std::array<int, kMaxTetrahedra>;
TetrahedronSigns SignsOf(const TetrahedralComplex& complex);

// The sign of the permutation that sorts the values. The values are distinct.
constexpr int PermutationSign(const std::array<int, 4>& values) {
  int sign = 1;
  for (int i = 0; i < 4; ++i) {
    for (int j = i + 1; j < 4; ++j) {
      if (values[i] > values[j]) sign = -sign;
    }
  }
  return sign;
}

}  // namespace palpate::lab
