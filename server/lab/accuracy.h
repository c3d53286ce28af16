// R_D: how much of a cell H puts on the wrong side.
//
// The volume of the symmetric difference of {F > τ} and {PL > τ}, F the trilinear
// interpolant and PL the piecewise-linear density of a decomposition, in % of the
// cell. The paper counts 1000³ samples. Here x and y are sampled in n×n columns,
// and along z, where F is linear and PL piecewise linear, lengths are exact: as
// many samples along z as the numbers have digits. The rest is the midpoint rule
// for a function of x and y that is smooth but on lines, as in the paper, with an
// error below 0.1 for n = 200 and about 0.01 for n = 1000.
//
// Where tetrahedra overlap, the first in the list counts. What none covers, a gap
// that only kTpbccPublished has, counts as inside: it is not known to be free (of
// the choices the one that comes closest to Table 4).
//
// Frame: index coordinates local to the cell. Threads: any ordinary thread; works
// on all cores, with the same bits on any number of them.
// Source: Corenthy et al., section 5.1 and Tables 1 and 4.
#pragma once

#include "common/isosurface/decomposition.h"

namespace palpate::lab {

struct Accuracy {
  double difference = 0.0;  // R_D
  double overlap = 0.0;     // volume covered more than once, by how often more
  double gap = 0.0;         // volume covered by no tetrahedron
};

// All in % of the cell. `columns`, n above, at least 1.
Accuracy MeasureAccuracy(const CellDensities& d, double isovalue, const Decomposition& cell,
                         int columns);

// R_D of the decomposition by `method`.
double DifferenceOf(const CellDensities& d, double isovalue, DecompositionMethod method,
                    int columns);

}  // namespace palpate::lab
