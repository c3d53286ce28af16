// OpenVDB's filters of whole volumes: offsets and mean-curvature flow of level sets
// (openvdb::tools::LevelSetFilter), and resampling (openvdb::tools::resampleToMatch: densities
// between the eight voxels around, a level set as a surface that is made anew).
//
// The result equals what OpenVDB makes on one thread, bit by bit, but that it stays within the
// range of the volume. What is resampled begins at the same first voxel. A level set that no longer
// fits gets a lattice that is larger, by whole bricks on any side; one that is resampled keeps as
// many voxels of a narrow band, and with it gets another range.
//
// Frames: I; the volume stays where it lies in W. Values in data units.
// Threads: any; on the caller's alone. Not for real-time code. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>

#include "server/volume/filter.h"

namespace palpate {

struct ReshapedVolume {
  VolumeMetadata metadata;
  BrickDirectory bricks;
};

// Whether a filter is one of whole volumes.
bool IsReshape(FilterKind kind);

// Cancelling is heard soon, but while a level set is resampled: its surface is made in one go.
// `needs`: told what will be taken, in bytes, its own work and the bricks that it makes, before it
// is; what it throws ends the filter. kInvalidArgument: not possible for this volume; kTooLarge;
// kCancelled.
ReshapedVolume Reshape(const VolumeSnapshot& volume, const VolumeFilter& filter,
                       const std::function<void(std::uint64_t bytes)>& needs,
                       const FilterProgress& progress, const FilterCancelled& cancelled);

}  // namespace palpate
