// What is felt of a volume: an isovalue or layers, by a point, a ball or a tool.
//
// Threads: pure functions. Errors: none.
#pragma once

#include "server/felt/felt_tip.h"
#include "server/felt/scene.h"

namespace palpate {

// The normalised density for an isovalue in data units: the largest density whose data value is not
// above the isovalue. So no density at or below it reads back above the isovalue.
double DensityOf(const VolumeSnapshot& volume, double isovalue);

// Makes the surface of a scene that has its volume and settings. `density`: of the one surface,
// which layers replace; they are in order (OrderLayers). `tip`: its fields are of the volume. While
// the field of another side is being made, the side of the tip's is felt.
void FeelSurface(const AffineMap& X_DI, double density, std::uint64_t geometry_revision,
                 const FeltTip& tip, Scene& scene);

}  // namespace palpate
