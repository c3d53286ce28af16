// Makes snapshots of an OpenVDB grid.
#pragma once

#include <openvdb/openvdb.h>

#include <cstdint>
#include <memory>

#include "server/volume/snapshot.h"

namespace palpate {

// The snapshot shares the leaf buffers of `grid`, which must not change any
// more, and keeps the grid alive. Non-real-time, any thread.
std::shared_ptr<const VolumeSnapshot> MakeSnapshot(openvdb::FloatGrid::ConstPtr grid,
                                                   const VolumeMetadata& metadata,
                                                   std::uint64_t revision);

// Least and greatest voxel of the lattice, 0 .. size-1. Throws Error where they
// are equal: such a volume has no isosurface.
void SetValueRange(const openvdb::FloatGrid& grid, VolumeMetadata& metadata);

}  // namespace palpate
