// Snapshots of small volumes given by a function, without OpenVDB.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <vector>

#include "server/volume/snapshot.h"

namespace palpate::testing {

// value(i, j, k) for every lattice vertex; the range is that of the values.
inline std::shared_ptr<const VolumeSnapshot> MakeVolume(
    const Vec3i& size, const std::function<double(int, int, int)>& value,
    std::uint64_t revision = 1) {
  VolumeMetadata metadata;
  metadata.size = size;
  const Vec3i count(BrickCount(size.x()), BrickCount(size.y()), BrickCount(size.z()));
  const std::size_t bricks = static_cast<std::size_t>(count.prod());
  auto voxels = std::make_shared<std::vector<float>>(bricks * VolumeSnapshot::kBrickVoxels);
  double min = 1e300, max = -1e300;
  for (int i = 0; i < size.x(); ++i) {
    for (int j = 0; j < size.y(); ++j) {
      for (int k = 0; k < size.z(); ++k) {
        const std::size_t brick =
            (static_cast<std::size_t>(i >> 3) * count.y() + (j >> 3)) * count.z() + (k >> 3);
        const auto v = static_cast<float>(value(i, j, k));
        (*voxels)[brick * VolumeSnapshot::kBrickVoxels + ((i & 7) << 6 | (j & 7) << 3 | (k & 7))] =
            v;
        min = std::min<double>(min, v);
        max = std::max<double>(max, v);
      }
    }
  }
  metadata.value_min = min;
  metadata.value_max = max;
  std::vector<const float*> directory(bricks);
  for (std::size_t n = 0; n < bricks; ++n) {
    directory[n] = voxels->data() + n * VolumeSnapshot::kBrickVoxels;
  }
  return std::make_shared<VolumeSnapshot>(metadata, std::move(directory), voxels, revision,
                                          voxels->size() * sizeof(float));
}

}  // namespace palpate::testing
