#include "server/volume/snapshot/snapshot.h"

#include <algorithm>
#include <utility>

namespace palpate {

VolumeSnapshot::VolumeSnapshot(VolumeMetadata metadata, BrickDirectory bricks,
                               std::uint64_t revision, std::uint64_t loaded_revision)
    : metadata_(std::move(metadata)),
      inverse_range_(1.0 / (metadata_.value_max - metadata_.value_min)),
      bricks_(std::move(bricks)),
      revision_(revision),
      loaded_revision_(loaded_revision) {}

double VolumeSnapshot::StoredVertex(const Vec3i& vertex) const noexcept {
  if ((vertex.array() < 0).any() || (vertex.array() >= metadata_.size.array()).any()) {
    return BackgroundDensity();
  }
  const int i = vertex.x(), j = vertex.y(), k = vertex.z();
  return Normalize(bricks_.Find(i, j, k)[VoxelInBrick(i, j, k)]);
}

CellDensities VolumeSnapshot::StoredCell(const Vec3i& cell) const noexcept {
  const int i = cell.x(), j = cell.y(), k = cell.z();
  const Vec3i last = metadata_.size - Vec3i::Ones();
  CellDensities d;
  const bool in_one_brick = (i & 7) != 7 && (j & 7) != 7 && (k & 7) != 7;
  if (in_one_brick && i >= 0 && j >= 0 && k >= 0 && i < last.x() && j < last.y() && k < last.z()) {
    const Leaf& leaf = bricks_.Find(i, j, k);
    VisitType(leaf.type(), [&](auto type) {
      const auto* const voxel = leaf.values<decltype(type)>() + VoxelInBrick(i, j, k);
      for (int v = 0; v < 8; ++v) {
        const auto& o = kCornerOffset[v];
        d[v] = Normalize(voxel[o[0] << 6 | o[1] << 3 | o[2]]);
      }
    });
    return d;
  }
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = StoredVertex(Vec3i(i + o[0], j + o[1], k + o[2]));
  }
  return d;
}

std::uint64_t VolumeSnapshot::CellRevision(const Vec3i& cell) const noexcept {
  const Vec3i last = metadata_.size - Vec3i::Ones();
  const Vec3i low = cell.cwiseMax(0), high = (cell + Vec3i::Ones()).cwiseMin(last);
  if ((low.array() > high.array()).any()) return 0;
  std::uint64_t newest = 0;
  for (int a = low.x() >> 3; a <= high.x() >> 3; ++a) {
    for (int b = low.y() >> 3; b <= high.y() >> 3; ++b) {
      for (int c = low.z() >> 3; c <= high.z() >> 3; ++c) {
        newest = std::max(newest, bricks_.RevisionOf({a, b, c}));
      }
    }
  }
  return newest;
}

}  // namespace palpate
