// Finds critical points of the trilinear interpolant and judges them in quadruple precision.
//
// Resolved ties (ties.h) differ by 1e-8 and less, and products of such differences decide at a
// saddle between them. In double precision, a count over a tied volume goes wrong. Densities are
// taken as exact; the results are only signs. This code is independent of
// common/isosurface/saddles.h and serves to check it.
//
// Frame: index coordinates local to the cell. Threads: pure functions. Slow: some microseconds for
// a body saddle.
#pragma once

#include <array>

#include "common/isosurface/cell.h"

namespace palpate::lab {

struct BodyCritical {
  bool above;                 // F there is above the isovalue
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
  // F rises from the face into the cell behind it, into the cell in front of it
  std::array<bool, 2> rises{};
};

// The saddle of a face with corners p, q, s, t in cyclic order. `behind` and `front` are the
// opposite corners in the cells on the two sides.
FaceCritical FindFaceCritical(const std::array<double, 4>& face,
                              const std::array<double, 4>& behind,
                              const std::array<double, 4>& front, double isovalue);

}  // namespace palpate::lab
