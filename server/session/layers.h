// Checks the layers of the settings, and fits them to another volume.
//
// Threads: pure functions.
#pragma once

#include <string>
#include <vector>

#include "common/contract/enumerations.h"
#include "common/contract/render.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// Sorts them by isovalue, and gives an id to those that have none (0): that of the layer of `felt`
// with the same name, or one that no layer has. Throws Error (kInvalidArgument) for what no layers
// can be: too many, ids or names twice, numbers out of range.
void OrderLayers(const SurfaceLayers& felt, SurfaceLayers& layers);

// Throws Error (kInvalidArgument) if there are layers and they would be felt from above.
void CheckSide(const SurfaceLayers& layers, FreeSide side);

// For layers in order: throws Error (kInvalidArgument) for isovalues out of the volume's range, and
// for two that are too close.
void CheckLayers(const SurfaceLayers& layers, const VolumeMetadata& volume);

// Leaves out the layers that the volume cannot have when it is felt from this side. Returns a line
// for people; empty: all fit.
std::string FitLayers(const VolumeMetadata& volume, FreeSide side, SurfaceLayers& layers);

}  // namespace palpate
