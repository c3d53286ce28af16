// Volumes given by a function of the voxel. The loops over all voxels are compiled only here,
// optimised for every test.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "server/volume/snapshot/snapshot.h"

namespace palpate::testing {

inline float ValueAt(const BrickDirectory& bricks, const Vec3i& p) {
  return bricks.Find(p.x(), p.y(), p.z())[VoxelInBrick(p.x(), p.y(), p.z())];
}
inline float ValueAt(const VolumeSnapshot& volume, const Vec3i& p) {
  return ValueAt(volume.bricks(), p);
}

// All its voxels are stored, unlike those of Leaf::Constant().
LeafPtr FilledLeaf(float value);

// Returns value(i, j, k) for each voxel of the lattice, 0 beyond.
BrickDirectory MakeBricks(const Vec3i& size, const std::function<float(int, int, int)>& value);

// Returns value(i, j, k) for every lattice vertex. The range is that of the values.
std::shared_ptr<const VolumeSnapshot> MakeVolume(const Vec3i& size,
                                                 const std::function<double(int, int, int)>& value,
                                                 std::uint64_t revision = 1);

// A volume of these leaves, each by the place of its brick.
std::shared_ptr<const VolumeSnapshot> VolumeOfLeaves(
    const Vec3i& size, const std::function<LeafPtr(const Vec3i&)>& leaf, double value_min = 0.0,
    double value_max = 1.0);

// Returns the bricks that contain voxels from <= p < end, with value() for each of these voxels.
std::vector<BrickChange> PaintedBox(const BrickDirectory& bricks, const Vec3i& from,
                                    const Vec3i& end, const std::function<float()>& value);

// The volume after the changes, at one revision more.
std::shared_ptr<const VolumeSnapshot> WithChanges(const VolumeSnapshot& volume,
                                                  std::span<const BrickChange> changes);

// The same voxels at another revision; brick 0 has changed at it.
std::shared_ptr<const VolumeSnapshot> Renumbered(const VolumeSnapshot& volume,
                                                 std::uint64_t revision);

// A cube with surfaces everywhere.
std::shared_ptr<const VolumeSnapshot> Gyroid(int size = 48, std::uint64_t revision = 1);

}  // namespace palpate::testing
