// R_D: the share of a cell that H puts on the wrong side.
//
// R_D is the volume of the symmetric difference of {F > τ} and {PL > τ}, in % of the cell. F is the
// trilinear interpolant. PL is the piecewise-linear density of a decomposition.
//
// The paper counts 1000³ samples. We sample x and y in n×n columns. Along z, F is linear and PL is
// piecewise linear, so the lengths along z are exact up to rounding. In x and y we use the midpoint
// rule, as the paper does; the function is smooth except on lines. The error is below 0.1 for n =
// 200 and about 0.01 for n = 1000.
//
// Where tetrahedra overlap, the first one in the list counts. A gap, which only kTpbccPublished
// has, counts as inside: a gap is not known to be free. Of the possible choices, this one comes
// closest to Table 4.
//
// Frame: index coordinates local to the cell.
// Threads: any ordinary thread; works on all cores. The result has the same bits on any number of
// cores.
// Source: Corenthy et al., section 5.1 and Tables 1 and 4.
#pragma once

#include "common/isosurface/sub_cell.h"
#include "server/lab/compared_method.h"

namespace palpate::lab {

struct Accuracy {
  double difference = 0.0;  // R_D
  double overlap = 0.0;     // volume covered more than once; counts once per extra cover
  double gap = 0.0;         // volume covered by no tetrahedron
};

// All results are in % of the cell. `columns`: n above, at least 1.
Accuracy MeasureAccuracy(const CellDensities& d, double isovalue, const Decomposition& cell,
                         int columns);

// R_D of the decomposition by `method`, of the whole cell or of its sub-cells (sub_cell.h).
double DifferenceOf(const CellDensities& d, double isovalue, ComparedMethod method, int columns,
                    int refinement = 1);

}  // namespace palpate::lab
