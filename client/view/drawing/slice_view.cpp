#include "client/view/drawing/slice_view.h"

#include <algorithm>

namespace palpate::view {

SliceView::SliceView(const SliceAxes& axes, const Vec3i& lattice_size, const Vec3& voxel_mm,
                     const ImageSize& size, const SliceZoom& zoom)
    : axes_(axes), zoom_(zoom) {
  const Eigen::Vector2d voxels = {lattice_size[axes.right.axis] + 1.0,
                                  lattice_size[axes.down.axis] + 1.0};
  const Eigen::Vector2d edges_mm = {voxel_mm[axes.right.axis], voxel_mm[axes.down.axis]};
  const Eigen::Vector2d slice_mm = voxels.cwiseProduct(edges_mm);
  const Eigen::Vector2d picture_px = {std::max(size.width, 1), std::max(size.height, 1)};
  const double px_per_mm = zoom.factor * picture_px.cwiseQuotient(slice_mm).minCoeff();
  const Eigen::Vector2d shown_px = px_per_mm * slice_mm;
  px_per_voxel_ =
      px_per_mm * edges_mm.cwiseProduct(Eigen::Vector2d(axes.right.sign, axes.down.sign));
  lattice_voxels_ = voxels;
  picture_px_ = picture_px;
  min_px_ = 0.5 * (picture_px - shown_px) - zoom.middle_voxels.cwiseProduct(px_per_voxel_);
  max_px_ = min_px_ + shown_px;
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

SliceZoom SliceView::ZoomedAt(const Eigen::Vector2d& point_px, double factor) const {
  const double wanted = std::clamp(zoom_.factor * factor, 1.0, SliceZoom::kMost);
  const Eigen::Vector2d from_middle_voxels =
      (point_px - 0.5 * picture_px_).cwiseQuotient(px_per_voxel_);
  return ShowAtMiddle(wanted,
                      zoom_.middle_voxels + from_middle_voxels * (1.0 - zoom_.factor / wanted));
}

SliceZoom SliceView::MovedBy(const Eigen::Vector2d& drag_px) const {
  return ShowAtMiddle(zoom_.factor, zoom_.middle_voxels - drag_px.cwiseQuotient(px_per_voxel_));
}

SliceZoom SliceView::ShowAtMiddle(double factor, const Eigen::Vector2d& middle_voxels) const {
  if (factor <= 1.0) return {};
  // The outermost voxels.
  const Eigen::Vector2d most = 0.5 * lattice_voxels_ - Eigen::Vector2d::Ones();
  return {factor, middle_voxels.cwiseMax(-most).cwiseMin(most)};
}

bool SliceView::Shows(const Eigen::Vector2d& point_px) const {
  return (point_px.array() >= min_px_.array()).all() && (point_px.array() <= max_px_.array()).all();
}

Vec3 VoxelEdges(const std::optional<AffineMap>& X_DI) {
  return X_DI ? Vec3(X_DI->linear.colwise().norm()) : Vec3(Vec3::Ones());
}

}  // namespace palpate::view
