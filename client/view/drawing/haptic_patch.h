// The haptic isosurface H near a point, as a wireframe. It shows what is felt, beside the drawn
// isosurface V. Computed with the daemon's own decomposition, with ties resolved, from stored
// values normalised over the range fixed at load.
//
// Frame: I. Threads: pure. Takes about 0.3 µs per cell, and more for cells that the surface
// crosses.
#pragma once

#include <vector>

#include "client/view/volume/view_volume.h"
#include "common/isosurface/decomposition.h"

namespace palpate::view {

// Returns the edges of H's triangles in cells within `radius_voxels` of `center_I` along each axis.
// Each edge appears once, as a pair of points.
std::vector<Vec3> HapticPatch(const ViewVolume& volume, double isovalue, DecompositionMethod method,
                              int refinement, const Vec3& center_I, double radius_voxels);

}  // namespace palpate::view
