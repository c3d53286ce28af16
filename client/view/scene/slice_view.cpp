#include "client/view/scene/slice_view.h"

#include <algorithm>

namespace palpate::view {

SliceView::SliceView(int axis, const Vec3i& lattice_size, const Vec3& voxel_mm,
                     const ImageSize& size)
    : axis_(axis), right_axis_(axis == 0 ? 1 : 0), down_axis_(axis == 2 ? 1 : 2) {
  const Eigen::Vector2d voxels = {lattice_size[right_axis_] + 1.0, lattice_size[down_axis_] + 1.0};
  const Eigen::Vector2d edges_mm = {voxel_mm[right_axis_], voxel_mm[down_axis_]};
  const Eigen::Vector2d slice_mm = voxels.cwiseProduct(edges_mm);
  const Eigen::Vector2d picture_px = {std::max(size.width, 1), std::max(size.height, 1)};
  const double px_per_mm = picture_px.cwiseQuotient(slice_mm).minCoeff();
  const Eigen::Vector2d shown_px = px_per_mm * slice_mm;
  min_px_ = 0.5 * (picture_px - shown_px);
  max_px_ = min_px_ + shown_px;
  px_per_voxel_ = px_per_mm * edges_mm;
  origin_px_ = min_px_ + px_per_voxel_;
  if (axis_ != 2) {
    px_per_voxel_.y() = -px_per_voxel_.y();
    origin_px_.y() = max_px_.y() + px_per_voxel_.y();
  }
}

Vec3 SliceView::PointAt(const Eigen::Vector2d& point_px, double position_voxels) const {
  const Eigen::Vector2d voxel = (point_px - origin_px_).cwiseQuotient(px_per_voxel_);
  Vec3 p_I;
  p_I[axis_] = position_voxels;
  p_I[right_axis_] = voxel.x();
  p_I[down_axis_] = voxel.y();
  return p_I;
}

Eigen::Vector2d SliceView::PixelOf(const Vec3& p_I) const {
  return origin_px_ +
         px_per_voxel_.cwiseProduct(Eigen::Vector2d(p_I[right_axis_], p_I[down_axis_]));
}

bool SliceView::Shows(const Eigen::Vector2d& point_px) const {
  return (point_px.array() >= min_px_.array()).all() && (point_px.array() <= max_px_.array()).all();
}

Vec3 VoxelEdges(const std::optional<AffineMap>& X_DI) {
  return X_DI ? Vec3(X_DI->linear.colwise().norm()) : Vec3(Vec3::Ones());
}

}  // namespace palpate::view
