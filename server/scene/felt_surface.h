// What is felt of a volume: an isovalue or layers, by a point or by a ball.
//
// Threads: pure functions. Errors: none.
#pragma once

#include "server/scene/felt_ball.h"
#include "server/scene/scene.h"

namespace palpate {

// The normalised density for an isovalue in data units: the largest density whose data value is not
// above the isovalue. So no density at or below it reads back above the isovalue.
double DensityOf(const VolumeSnapshot& volume, double isovalue);

// Makes the surface of a scene that has its volume and settings. `density`: of the one surface,
// which layers replace; they are in order (OrderLayers). `ball`: of the volume; none: a point.
// While the field of another side is being made, the ball's side is felt.
void FeelSurface(const AffineMap& X_DI, double density, std::uint64_t geometry_revision,
                 const std::optional<FeltBall>& ball, Scene& scene);

}  // namespace palpate
