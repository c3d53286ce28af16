// What an isovalue in data units, and the layers of the settings, are on a volume.
//
// Threads: pure functions. Errors: none.
#pragma once

#include "server/scene/scene.h"

namespace palpate {

// The normalised density for an isovalue in data units: the largest density whose data value is not
// above the isovalue. So no density at or below it reads back above the isovalue.
double DensityOf(const VolumeSnapshot& volume, double isovalue);

// Makes the scene's surface that of its settings' layers, which are in order (OrderLayers). Without
// layers, it stays the one surface.
void FeelLayers(Scene& scene);

}  // namespace palpate
