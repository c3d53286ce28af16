// Snapshots of OpenVDB grids.
//
// Non-real-time, any thread.
#pragma once

#include <cstdint>
#include <memory>

#include "server/volume/openvdb_names.h"
#include "server/volume/snapshot.h"

namespace palpate {

// A freshly loaded volume with the voxels of `grid`, which holds nothing but the
// background outside of the lattice.
std::shared_ptr<const VolumeSnapshot> MakeSnapshot(std::shared_ptr<const openvdb::FloatGrid> grid,
                                                   const VolumeMetadata& metadata,
                                                   std::uint64_t revision);
// The bricks alone, taking the leaves out of the grid one by one, so that there is
// never a second copy of the volume. The grid is of no use afterwards.
BrickDirectory TakeBricks(openvdb::FloatGrid& grid, const Vec3i& size_voxels);

// Least and greatest voxel of the lattice, 0 .. size-1. Throws Error where they
// are equal: such a volume has no isosurface.
void SetValueRange(const openvdb::FloatGrid& grid, VolumeMetadata& metadata);

}  // namespace palpate
