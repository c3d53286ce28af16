// Volumes given by a function of the voxel. The loops over all voxels are compiled here once,
// optimised, whatever the test is.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "server/volume/snapshot.h"

namespace palpate::testing {

// value(i, j, k) for each voxel of the lattice, 0 beyond.
BrickDirectory MakeBricks(const Vec3i& size, const std::function<float(int, int, int)>& value);

// value(i, j, k) for every lattice vertex; the range is that of the values.
std::shared_ptr<const VolumeSnapshot> MakeVolume(const Vec3i& size,
                                                 const std::function<double(int, int, int)>& value,
                                                 std::uint64_t revision = 1);

// The bricks of `bricks` in from <= p < end, with value() in place of each voxel there.
std::vector<BrickChange> PaintedBox(const BrickDirectory& bricks, const Vec3i& from,
                                    const Vec3i& end, const std::function<float()>& value);

// A cube with surfaces everywhere.
std::shared_ptr<const VolumeSnapshot> Gyroid(int size = 48, std::uint64_t revision = 1);

}  // namespace palpate::testing
