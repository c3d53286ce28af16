// The haptic isosurface H near a point, as a wireframe: what is felt there, beside the
// isosurface V that is drawn. Computed with the daemon's own decomposition, ties
// resolved, on stored values normalised over the range fixed at load.
//
// Frame: I. Threads: pure. Takes about 0.3 µs for a cell and more for those that the
// surface crosses.
#pragma once

#include <vector>

#include "client/view/volume/view_volume.h"
#include "common/isosurface/decomposition.h"

namespace palpate::view {

// Edges of the triangles of H in cells within `radius_voxels` of `center_I`, along
// each axis, each once; pairs of points.
std::vector<Vec3> HapticPatch(const ViewVolume& volume, double isovalue, DecompositionMethod method,
                              const Vec3& center_I, double radius_voxels);

}  // namespace palpate::view
