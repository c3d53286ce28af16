// Finds out whether a proxy can have come from one position to another through free space.
//
// Searches the decomposed volume, independently of the proxy's moves. The nodes of the search are:
// - the tetrahedra of crossed cells that have a free vertex,
// - whole free cells,
// - the outside.
// Two nodes are neighbours if they share a face whose free part is not empty. Within a tick, the
// proxy's distance to the HIP never grows. So the path lies in the ball around the HIP whose
// surface holds the start, and the search enters only cells that meet this ball.
//
// Frame: D (mm). Threads: one per FreshCells. Errors: none.
#pragma once

#include "server/lab/fresh_cells.h"

namespace palpate::lab {

enum class FreePath {
  kFound,
  kNone,       // there is no path within the ball
  kUnchecked,  // the search was cut off
};

inline constexpr int kMostPathNodes = 50'000;

FreePath FindFreePath(FreshCells& cells, const Vec3& from_mm, const Vec3& to_mm,
                      const Vec3& p_DHip_mm, int most_nodes = kMostPathNodes);

}  // namespace palpate::lab
