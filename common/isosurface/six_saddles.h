// The published rules for cells with six face saddles (Corenthy et al., section
// 3.4), which Table 4 shows its TPTD to share. Defined in tpbcc_published.cpp.
//
// Frame: index coordinates local to the cell.
// Threads: pure functions. Real-time: no allocation, no locks.
#pragma once

#include "common/isosurface/placement.h"

namespace palpate {

// Which face serves as the partner of the n-th lowest.
enum class FacePartner : std::uint8_t {
  kByRank,    // as printed: the n-th highest, parallel to it or not
  kParallel,  // the face across, whatever its rank: nothing overlaps then
};

// `out` holds the corners and the six face vertices, at their saddles.
void DecomposeSixSaddles(const CellDensities& d, const CellSaddles& saddles, FacePartner partner,
                         Decomposition& out);

}  // namespace palpate
