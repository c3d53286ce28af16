// What an isovalue in data units, and the layers of the settings, are on a volume.
//
// Threads: pure functions. Errors: none.
#pragma once

#include <memory>

#include "server/haptics/settings.h"
#include "server/scene/scene.h"

namespace palpate {

// The normalised density for an isovalue in data units: the largest density whose data value is not
// above the isovalue. So no density at or below it reads back above the isovalue.
double DensityOf(const VolumeSnapshot& volume, double isovalue);

// Null without layers. They must be in order (CheckLayers).
std::shared_ptr<const HapticLayers> FeltLayers(const VolumeSnapshot& volume,
                                               const SurfaceLayers& layers);

// Makes the scene's surface that of its settings' layers, if they have any.
void FeelLayers(Scene& scene);

}  // namespace palpate
