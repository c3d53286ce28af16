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
  double min = 1e300, max = -1e300;
  const auto is_inside = [&](const Vec3i& p) { return (p.array() < size.array()).all(); };
  const auto for_each = [](const Vec3i& brick, const auto& visit) {
    for (int n = 0; n < kBrickVoxels; ++n) {
      visit(brick * kBrickEdge + Vec3i(n >> 6, n >> 3 & 7, n & 7), n);
    }
  };
  const BrickDirectory bricks(size, [&](const Vec3i& brick) {
    auto values = std::make_shared<Brick>();
    for_each(brick, [&](const Vec3i& p, int n) {
      if (!is_inside(p)) return;
      (*values)[n] = static_cast<float>(value(p.x(), p.y(), p.z()));
      min = std::min<double>(min, (*values)[n]);
      max = std::max<double>(max, (*values)[n]);
    });
    return values;
  });
  metadata.value_min = min;
  metadata.value_max = max;
  return std::make_shared<VolumeSnapshot>(metadata, bricks.AllChangedAt(revision), revision,
                                          revision);
}

}  // namespace palpate::testing
