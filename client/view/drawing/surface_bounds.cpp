#include "client/view/drawing/surface_bounds.h"

namespace palpate::view {

std::optional<Bounds> SurfaceBounds(const ViewVolume& volume, double isovalue) {
  if (!volume.lattice() || !volume.X_DI()) return std::nullopt;
  const auto is_crossed = [&](const ValueRange& range) {
    return static_cast<double>(range.min) <= isovalue && isovalue <= static_cast<double>(range.max);
  };
  Eigen::AlignedBox3i bricks;  // of cells
  const std::vector<CellBlock>& blocks = volume.cell_blocks();
  for (std::size_t number = 0; number < blocks.size(); ++number) {
    // Only bricks that vary are looked at.
    if (!blocks[number].bricks || !is_crossed(blocks[number].range)) continue;
    const Vec3i first = BrickWithNumber(number, volume.cell_block_count()) * kBrickEdge;
    for (int place = 0; place < kBrickVoxels; ++place) {
      if (!is_crossed((*blocks[number].bricks)[static_cast<std::size_t>(place)])) continue;
      bricks.extend(Vec3i(first + Vec3i(place >> 6, place >> 3 & 7, place & 7)));
    }
  }
  if (bricks.isEmpty()) return std::nullopt;
  const Vec3i first = bricks.min() * kBrickEdge - Vec3i::Ones();
  const Vec3i last = (bricks.max() + Vec3i::Ones()) * kBrickEdge - Vec3i::Ones();
  const Vec3i last_voxel = volume.lattice()->size - Vec3i::Ones();
  return BoundsOf(*volume.X_DI(), first.cwiseMax(0).cast<double>(),
                  last.cwiseMin(last_voxel).cast<double>());
}

}  // namespace palpate::view
