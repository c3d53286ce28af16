// Whether a proxy can have come from one position to another through free space.
//
// A search over the decomposed volume, independent of the proxy's moves. Nodes are
// the tetrahedra of crossed cells that have a free vertex, whole free cells, and
// the outside; neighbours share a face whose free part is not empty. A proxy's
// distance to the HIP never grows within a tick, so that its way lies in the ball
// round the HIP that its start lies on: only cells that meet the ball are entered.
//
// Frame: D (mm). Threads: one per FreshCells. Errors: none.
#pragma once

#include "server/lab/fresh_cells.h"

namespace palpate::lab {

enum class FreePath {
  kFound,
  kNone,       // shown: there is none within the ball
  kUnchecked,  // the search was cut off
};

inline constexpr int kMostPathNodes = 50'000;

FreePath FindFreePath(FreshCells& cells, const Vec3& from_mm, const Vec3& to_mm,
                      const Vec3& p_DHip_mm, int most_nodes = kMostPathNodes);

}  // namespace palpate::lab
