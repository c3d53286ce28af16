// Makes snapshots from OpenVDB grids.
//
// Non-real-time, any thread.
#pragma once

#include <cstdint>
#include <memory>

#include "server/volume/snapshot/openvdb_names.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// Returns a freshly loaded volume with the voxels of `grid`. Outside the lattice, the grid must
// hold only background.
std::shared_ptr<const VolumeSnapshot> MakeSnapshot(std::shared_ptr<const openvdb::FloatGrid> grid,
                                                   const VolumeMetadata& metadata,
                                                   std::uint64_t revision);
// Returns only the bricks. Takes the leaves out of the grid one by one, so that there is never a
// second copy of the volume. The grid must not be used afterwards.
BrickDirectory TakeBricks(openvdb::FloatGrid& grid, const Vec3i& size_voxels);

// Sets the least and greatest voxel of the lattice, 0 .. size-1. Throws Error if they are equal:
// such a volume has no isosurface.
void SetValueRange(const openvdb::FloatGrid& grid, VolumeMetadata& metadata);

}  // namespace palpate
