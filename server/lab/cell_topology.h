// Topology of H in one decomposed cell.
//
// Threads: pure function. Takes some microseconds. Apart for its tests.
#pragma once

#include "common/isosurface/decomposition.h"

namespace palpate::lab {

struct CellTopology {
  int above = 0;    // components of {density > τ}
  int below = 0;    // components of {density <= τ}
  int surface = 0;  // components of H
  int euler = 0;    // Euler characteristic of H

  bool operator==(const CellTopology&) const = default;
};

// Looks only at the complex, not at the positions of its vertices. If the complex overlaps itself
// or has gaps (kTpbccPublished), the Euler characteristic shows that triangles do not match.
CellTopology CountCellTopology(const Decomposition& cell, double isovalue);

}  // namespace palpate::lab
