#include "server/volume_stream/overview.h"

#include <algorithm>

#include "common/bricks/volume_event.h"

namespace palpate {
namespace {

// A block lies within one brick.
static_assert(kBrickEdge % kOverviewEdge == 0);

float MeanOfBlock(const VolumeSnapshot& volume, const Vec3i& block) {
  const Vec3i first = block * kOverviewEdge;
  const Vec3i end = (first.array() + kOverviewEdge).min(volume.size().array()).matrix();
  const Leaf& leaf = volume.bricks().Find(first.x(), first.y(), first.z());
  double sum = 0.0;
  for (int i = first.x(); i < end.x(); ++i) {
    for (int j = first.y(); j < end.y(); ++j) {
      for (int k = first.z(); k < end.z(); ++k) sum += leaf[VoxelInBrick(i, j, k)];
    }
  }
  return static_cast<float>(sum / (end - first).prod());
}

}  // namespace

Vec3i OverviewSize(const Vec3i& size_voxels) {
  return {OverviewCount(size_voxels.x()), OverviewCount(size_voxels.y()),
          OverviewCount(size_voxels.z())};
}

void FillOverview(const VolumeSnapshot& volume, std::uint64_t first, std::span<float> means) {
  const Vec3i size = OverviewSize(volume.size());
  for (std::size_t n = 0; n < means.size(); ++n) {
    // Blocks are numbered as bricks are.
    means[n] = MeanOfBlock(volume, BrickWithNumber(first + n, size));
  }
}

}  // namespace palpate
