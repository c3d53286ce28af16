#include "client/view/scene/slice_view.h"

#include <algorithm>

namespace palpate::view {

SliceView::SliceView(const SliceAxes& axes, const Vec3i& lattice_size, const Vec3& voxel_mm,
                     const ImageSize& size)
    : axes_(axes) {
  const Eigen::Vector2d voxels = {lattice_size[axes.right.axis] + 1.0,
                                  lattice_size[axes.down.axis] + 1.0};
  const Eigen::Vector2d edges_mm = {voxel_mm[axes.right.axis], voxel_mm[axes.down.axis]};
  const Eigen::Vector2d slice_mm = voxels.cwiseProduct(edges_mm);
  const Eigen::Vector2d picture_px = {std::max(size.width, 1), std::max(size.height, 1)};
  const double px_per_mm = picture_px.cwiseQuotient(slice_mm).minCoeff();
  const Eigen::Vector2d shown_px = px_per_mm * slice_mm;
  min_px_ = 0.5 * (picture_px - shown_px);
  max_px_ = min_px_ + shown_px;
  px_per_voxel_ =
      px_per_mm * edges_mm.cwiseProduct(Eigen::Vector2d(axes.right.sign, axes.down.sign));
  // The layer of background is before voxel 0, on the side where the axis begins.
  origin_px_ = (px_per_voxel_.array() > 0.0).select(min_px_, max_px_) + px_per_voxel_;
}

Vec3 SliceView::PointAt(const Eigen::Vector2d& point_px, double position_voxels) const {
  const Eigen::Vector2d voxel = (point_px - origin_px_).cwiseQuotient(px_per_voxel_);
  Vec3 p_I;
  p_I[axes_.across.axis] = position_voxels;
  p_I[axes_.right.axis] = voxel.x();
  p_I[axes_.down.axis] = voxel.y();
  return p_I;
}

Eigen::Vector2d SliceView::PixelOf(const Vec3& p_I) const {
  const Eigen::Vector2d voxel = {p_I[axes_.right.axis], p_I[axes_.down.axis]};
  return origin_px_ + px_per_voxel_.cwiseProduct(voxel);
}

bool SliceView::Shows(const Eigen::Vector2d& point_px) const {
  return (point_px.array() >= min_px_.array()).all() && (point_px.array() <= max_px_.array()).all();
}

Vec3 VoxelEdges(const std::optional<AffineMap>& X_DI) {
  return X_DI ? Vec3(X_DI->linear.colwise().norm()) : Vec3(Vec3::Ones());
}

}  // namespace palpate::view
