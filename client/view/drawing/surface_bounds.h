// Where a volume has a surface. Its box is often much larger.
//
// Threads: pure.
#pragma once

#include <optional>

#include "client/view/drawing/camera.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

// A box in D around the bricks that an isosurface crosses, with up to a brick around the surface
// itself. None if it crosses none, and without a lattice and its place.
std::optional<Bounds> SurfaceBounds(const ViewVolume& volume, double isovalue);

}  // namespace palpate::view
