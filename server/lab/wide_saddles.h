// Critical points of the trilinear interpolant, judged in quadruple precision.
//
// Resolved ties (ties.h) differ by 1e-8 and less, and what decides at a saddle
// between them are products of such differences: in double precision a count over
// a tied volume goes wrong. Densities are taken as exact; only signs come out.
// Independent of common/isosurface/saddles.h, which it serves to check.
//
// Frame: index coordinates local to the cell. Threads: pure functions. Slow: some
// microseconds for a body saddle.
#pragma once

#include <array>

#include "common/isosurface/cell.h"

namespace palpate::lab {

struct BodyCritical {
  bool above;                 // the isovalue
  bool positive_determinant;  // of the Hessian
};

struct BodyCriticals {
  int count = 0;
  std::array<BodyCritical, 2> point;
};

// Zeros of ∇F strictly inside the cell.
BodyCriticals FindBodyCriticals(const CellDensities& d, double isovalue);

struct FaceCritical {
  bool exists = false;  // strictly inside the face
  bool above = false;
  std::array<bool, 2> rises{};  // from the face into the cell behind it, in front of it
};

// The saddle of a face with corners p, q, s, t in cyclic order; `behind` and
// `front` are the corners opposite to them in the cells on the two sides.
FaceCritical FindFaceCritical(const std::array<double, 4>& face,
                              const std::array<double, 4>& behind,
                              const std::array<double, 4>& front, double isovalue);

}  // namespace palpate::lab
