// Volumes for tests of the viewer, like those of the client library.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "client/sdk/volume_update.h"
#include "client/view/volume/view_volume.h"
#include "tests/support/cpu_caster.h"

namespace palpate::testing {

// A brick in this type, or of floats if the type does not hold a value.
inline TypedBrickPtr BrickOf(const VoxelArray& voxels, const Vec3i& brick,
                             LeafType type = LeafType::kFloat) {
  Brick values;
  for (int n = 0; n < kBrickVoxels; ++n) {
    values[static_cast<std::size_t>(n)] =
        voxels.At(8 * brick.x() + (n >> 6), 8 * brick.y() + (n >> 3 & 7), 8 * brick.z() + (n & 7));
  }
  const auto holds = [&](float value) { return Holds(type, value); };
  if (!std::all_of(values.begin(), values.end(), holds)) type = LeafType::kFloat;
  const auto is_first = [&](float value) { return value == values.front(); };
  if (std::all_of(values.begin(), values.end(), is_first)) {
    return TypedBrick::Constant(type, values.front());
  }
  return VisitType(type, [&](auto voxel) {
    std::array<decltype(voxel), kBrickVoxels> typed;
    std::transform(values.begin(), values.end(), typed.begin(),
                   [](float value) { return static_cast<decltype(voxel)>(value); });
    return TypedBrick::Of<decltype(voxel)>(typed);
  });
}

// All bricks of `voxels`.
inline BrickMap BricksOf(const VoxelArray& voxels, LeafType type = LeafType::kFloat) {
  VolumeLattice lattice;
  lattice.size = voxels.size;
  BrickMap bricks(lattice.BrickCounts(), TypedBrick::Constant(LeafType::kFloat, voxels.background));
  for (std::uint64_t number = 0; number < lattice.Bricks(); ++number) {
    bricks.Put(number, BrickOf(voxels, BrickWithNumber(number, lattice.BrickCounts()), type));
  }
  return bricks;
}

// A complete volume.
inline client::VolumeUpdate WholeVolume(const VoxelArray& voxels, const AffineMap& X_DI,
                                        LeafType type = LeafType::kFloat) {
  client::VolumeUpdate update;
  update.all = true;
  VolumeLattice lattice;
  lattice.size = voxels.size;
  lattice.value_min = voxels.background;
  lattice.value_max = *std::max_element(voxels.values.begin(), voxels.values.end());
  lattice.type = type;
  update.lattice = lattice;
  update.placement.emplace().device_from_index = X_DI;
  update.bricks = BricksOf(voxels, type).Share();
  update.changed = {{0, lattice.Bricks()}};
  update.complete.emplace();
  return update;
}

// Some bricks of a volume become those of `voxels`.
inline client::VolumeUpdate Edit(const view::ViewVolume& volume, const VoxelArray& voxels,
                                 const std::vector<Vec3i>& bricks,
                                 LeafType type = LeafType::kFloat) {
  client::VolumeUpdate update;
  update.lattice = volume.lattice();
  update.placement.emplace().device_from_index = volume.X_DI().value();
  const Vec3i counts = update.lattice->BrickCounts();
  BrickMap map(counts, TypedBrick::Constant(LeafType::kFloat, update.lattice->Background()));
  map.CopyFrom(volume.bricks(), {0, map.size()});
  for (const Vec3i& brick : bricks) {
    map.Put(BrickNumber(brick, counts), BrickOf(voxels, brick, type));
    update.changed.push_back({BrickNumber(brick, counts), 1});
  }
  std::sort(update.changed.begin(), update.changed.end(),
            [](const BrickRun& a, const BrickRun& b) { return a.first < b.first; });
  update.bricks = map.Share();
  update.complete.emplace();
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
