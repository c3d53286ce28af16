#include "client/view/scene/projection.h"

#include <algorithm>

namespace palpate::view {
namespace {

constexpr double kNearest_mm = 1e-6;

}  // namespace

Projection::Projection(const Camera& camera, const ImageSize& size)
    : camera_(camera),
      size_{std::max(size.width, 1), std::max(size.height, 1)},
      X_VD_(camera.X_VD()),
      eye_D_(camera.Eye()) {
  const Mat4 clip = camera.ClipFromView(size_, Bounds{});
  px_per_slope_ = {0.5 * size_.width * clip(0, 0), 0.5 * size_.height * clip(1, 1)};
}

std::optional<Eigen::Vector2d> Projection::PixelOf(const Vec3& p_D) const {
  const Vec3 p_V = X_VD_.Apply(p_D);
  if (!(-p_V.z() > kNearest_mm)) return std::nullopt;
  return Eigen::Vector2d(0.5 * size_.width - px_per_slope_.x() * p_V.x() / p_V.z(),
                         0.5 * size_.height + px_per_slope_.y() * p_V.y() / p_V.z());
}

double Projection::MmPerPixel(const Vec3& p_D) const {
  return std::max(DepthOf(p_D), kNearest_mm) / px_per_slope_.y();
}

Ray Projection::RayThrough(const Eigen::Vector2d& at_px) const {
  return camera_.RayThrough(at_px.x(), at_px.y(), size_);
}

}  // namespace palpate::view
