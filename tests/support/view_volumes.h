// Volumes for tests of the viewer, like those of the client library.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>

#include "client/sdk/volume_update.h"
#include "tests/support/cpu_caster.h"

namespace palpate::testing {

inline BrickPtr BrickOf(const VoxelArray& voxels, const Vec3i& brick) {
  auto values = std::make_shared<Brick>();
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) {
      for (int k = 0; k < 8; ++k) {
        (*values)[VoxelInBrick(i, j, k)] =
            voxels.At(8 * brick.x() + i, 8 * brick.y() + j, 8 * brick.z() + k);
      }
    }
  }
  return values;
}

// A complete volume.
inline client::VolumeUpdate WholeVolume(const VoxelArray& voxels, const AffineMap& X_DI) {
  client::VolumeUpdate update;
  update.all = true;
  VolumeLattice lattice;
  lattice.size = voxels.size;
  lattice.value_min = voxels.background;
  lattice.value_max = *std::max_element(voxels.values.begin(), voxels.values.end());
  update.lattice = lattice;
  update.placement.emplace().X_DI = X_DI;
  for (std::uint64_t number = 0; number < lattice.Bricks(); ++number) {
    update.bricks.push_back(
        {number, BrickOf(voxels, BrickWithNumber(number, lattice.BrickCounts()))});
  }
  return update;
}

// A volume from a function of I. Its range may be wider than the function's values. The background
// is the range's least value.
inline client::VolumeUpdate VolumeOf(const Vec3i& size,
                                     const std::function<double(const Vec3&)>& value,
                                     const AffineMap& X_DI, double min, double max) {
  VoxelArray voxels = MakeVoxels(
      size, [&](int i, int j, int k) { return static_cast<float>(value(Vec3(i, j, k))); });
  voxels.background = static_cast<float>(min);
  client::VolumeUpdate update = WholeVolume(voxels, X_DI);
  update.lattice->value_max = max;
  return update;
}

}  // namespace palpate::testing
