// The published rules for cells with six face saddles (Corenthy et al., section 3.4). Table 4 shows
// that the published TPTD uses the same rules. Defined in tpbcc_published.cpp.
//
// Frame: index coordinates local to the cell.
// Threads: pure functions. Real-time: no allocation, no locks.
#pragma once

#include <cstdint>

#include "server/lab/compared_method.h"

namespace palpate::lab {

// The partner of the n-th lowest face.
enum class FacePartner : std::uint8_t {
  kByRank,    // as printed: the n-th highest, parallel to it or not
  kParallel,  // the opposite face, whatever its rank; nothing overlaps then
};

// `out` already has the corners, and the six face vertices at their saddles.
void DecomposeSixSaddles(const CellDensities& d, const CellSaddles& saddles, FacePartner partner,
                         Decomposition& out);

}  // namespace palpate::lab
