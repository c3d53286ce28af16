// OpenVDB's filters of whole volumes:
// - offsets and mean-curvature flow of level sets (openvdb::tools::LevelSetFilter),
// - resampling (openvdb::tools::resampleToMatch): densities are interpolated between the eight
//   voxels around; the surface of a level set is computed anew.
//
// The result equals OpenVDB's result on one thread, bit by bit, except that it is clamped to the
// volume's range. A resampled volume begins at the same first voxel. If a level set no longer fits
// its lattice, it gets a larger one, by whole bricks on any side. A resampled level set keeps the
// number of voxels in its narrow band, and so gets another range.
//
// Frames: I; the volume stays in its place in W. Values in data units.
// Threads: any; works only on the caller's thread. Not for real-time code. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>

#include "server/volume/edit/filter.h"

namespace palpate {

struct ReshapedVolume {
  VolumeMetadata metadata;
  BrickDirectory bricks;
};

// True for the filters of whole volumes.
bool IsReshape(FilterKind kind);

// Cancelling takes effect soon, except while a level set is resampled: its surface is made in one
// step. `needs`: called before memory is taken, with the bytes for the filter's own work and its
// bricks; an exception from it ends the filter. Throws kInvalidArgument if the filter is not
// possible for this volume; kTooLarge; kCancelled.
ReshapedVolume Reshape(const VolumeSnapshot& volume, const VolumeFilter& filter,
                       const std::function<void(std::uint64_t bytes)>& needs,
                       const FilterProgress& progress, const FilterCancelled& cancelled);

}  // namespace palpate
