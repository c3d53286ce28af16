#include "client/view/scene/surface_bounds.h"

namespace palpate::view {
namespace {

// Only bricks that vary are looked at.
template <typename Visit>
void ForEachCrossedBrick(const ViewVolume& volume, double isovalue, const Visit& visit) {
  const auto is_crossed = [&](const ValueRange& range) {
    return static_cast<double>(range.min) <= isovalue && isovalue <= static_cast<double>(range.max);
  };
  const std::vector<CellBlock>& blocks = volume.cell_blocks();
  for (std::size_t number = 0; number < blocks.size(); ++number) {
    if (!blocks[number].bricks || !is_crossed(blocks[number].range)) continue;
    const Vec3i first = BrickWithNumber(number, volume.cell_block_count()) * kBrickEdge;
    for (int place = 0; place < kBrickVoxels; ++place) {
      if (!is_crossed((*blocks[number].bricks)[static_cast<std::size_t>(place)])) continue;
      visit(Vec3i(first + Vec3i(place >> 6, place >> 3 & 7, place & 7)));
    }
  }
}

}  // namespace

std::optional<Bounds> SurfaceBounds(const ViewVolume& volume, double isovalue) {
  if (!volume.lattice() || !volume.X_DI()) return std::nullopt;
  Eigen::AlignedBox3d box_I;
  ForEachCrossedBrick(volume, isovalue, [&](const Vec3i& cell_brick) {
    const Vec3 first_I = (cell_brick * kBrickEdge - Vec3i::Ones()).cast<double>();
    box_I.extend(first_I);
    box_I.extend(first_I + Vec3::Constant(kBrickEdge));
  });
  if (box_I.isEmpty()) return std::nullopt;
  const Vec3 last_I = volume.lattice()->size.cast<double>() - Vec3::Ones();
  box_I = box_I.intersection(Eigen::AlignedBox3d(Vec3(Vec3::Zero()), last_I));
  Eigen::AlignedBox3d box_D;
  for (int corner = 0; corner < 8; ++corner) {
    box_D.extend(
        volume.X_DI()->Apply(box_I.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner))));
  }
  return Bounds{.min_mm = box_D.min(), .max_mm = box_D.max()};
}

}  // namespace palpate::view
