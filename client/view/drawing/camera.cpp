#include "client/view/drawing/camera.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::view {
namespace {

constexpr double kMaxElevation_deg = 89.0;
constexpr double kMinDistance_mm = 1e-3;
constexpr double kMaxDistance_mm = 1e6;
constexpr double kResetAzimuth_deg = 30.0;
constexpr double kResetElevation_deg = 20.0;
// Of the distance that fits exactly: room for the letters.
constexpr double kFitMargin = 1.05;
// The nearest visible distance, as a share of the distance to the target.
constexpr double kNearShare = 0.01;
// Nearer points are beside or behind the eye.
constexpr double kNearest_mm = 1e-6;

double Radians(double degrees) { return degrees * std::numbers::pi / 180.0; }

// Half of the visible width and height at a distance of 1.
struct HalfView {
  double across;
  double up;
};

HalfView HalfViewOf(const ImageSize& size) {
  const double shorter = std::tan(Radians(0.5 * Camera::kFieldOfView_deg));
  const double aspect = static_cast<double>(std::max(size.width, 1)) / std::max(size.height, 1);
  return {shorter * std::max(aspect, 1.0), shorter * std::max(1.0 / aspect, 1.0)};
}

}  // namespace

Bounds BoundsOf(const AffineMap& map, const Vec3& min, const Vec3& max) {
  const Vec3 middle_mm = map.Apply(0.5 * (min + max));
  const Vec3 reach_mm = map.linear.cwiseAbs() * (0.5 * (max - min)).cwiseAbs();
  return {middle_mm - reach_mm, middle_mm + reach_mm};
}

void Camera::Reset(const Bounds& bounds) {
  R_DU_ = Mat3::Identity();
  Set(target_D_, kResetAzimuth_deg, kResetElevation_deg, distance_mm_);
  Fit(bounds);
}

void Camera::Fit(const Bounds& bounds) {
  const Vec3 middle_D = 0.5 * (bounds.min_mm + bounds.max_mm);
  const Mat3 R_VD = X_VD().linear;
  const double half = std::tan(Radians(0.5 * kFieldOfView_deg));
  double distance_mm = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 side(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5);
    const Vec3 p_V = R_VD * side.cwiseProduct(bounds.max_mm - bounds.min_mm);
    const double aside = std::max(std::abs(p_V.x()), std::abs(p_V.y()));
    distance_mm = std::max(distance_mm, p_V.z() + kFitMargin * aside / half);
  }
  Set(middle_D, azimuth_deg_, elevation_deg_, distance_mm);
}

void Camera::Orbit(double azimuth_deg, double elevation_deg) {
  Set(target_D_, azimuth_deg_ + azimuth_deg, elevation_deg_ + elevation_deg, distance_mm_);
}

void Camera::Zoom(double factor) {
  if (!(factor > 0.0)) return;
  Set(target_D_, azimuth_deg_, elevation_deg_, distance_mm_ / factor);
}

void Camera::Pan(double right_px, double down_px, const ImageSize& size) {
  const Mat3 R_VD = X_VD().linear;
  target_D_ += R_VD.transpose() * Vec3(-right_px, down_px, 0.0) * MmPerPixel(size);
}

void Camera::LookAt(const Vec3& target_D) { target_D_ = target_D; }

void Camera::Set(const Vec3& target_D, double azimuth_deg, double elevation_deg,
                 double distance_mm) {
  target_D_ = target_D;
  azimuth_deg_ = std::remainder(azimuth_deg, 360.0);
  elevation_deg_ = std::clamp(elevation_deg, -kMaxElevation_deg, kMaxElevation_deg);
  distance_mm_ = std::clamp(distance_mm, kMinDistance_mm, kMaxDistance_mm);
}

Vec3 Camera::Eye() const {
  const double a = Radians(azimuth_deg_), e = Radians(elevation_deg_);
  const Vec3 towards(std::sin(a) * std::cos(e), std::sin(e), std::cos(a) * std::cos(e));
  return target_D_ + distance_mm_ * (R_DU_ * towards);
}

AffineMap Camera::X_VD() const {
  const Vec3 eye = Eye();
  const Vec3 back = (eye - target_D_).normalized();
  const Vec3 right = R_DU_.col(1).cross(back).normalized();
  AffineMap X;
  X.linear.row(0) = right;
  X.linear.row(1) = back.cross(right);
  X.linear.row(2) = back;
  X.translation = -(X.linear * eye);
  return X;
}

Mat4 Camera::ClipFromD(const ImageSize& size, const Bounds& bounds) const {
  const HalfView half = HalfViewOf(size);
  const AffineMap X = X_VD();
  const Bounds box_V = BoundsOf(X, bounds.min_mm, bounds.max_mm);
  // Room for objects that stick out: a stylus, an arrow.
  const double margin = 0.5 * (bounds.max_mm - bounds.min_mm).norm() + 0.1 * distance_mm_;
  const double near_mm =
      std::max(std::min(distance_mm_, -box_V.max_mm.z()) - margin, kNearShare * distance_mm_);
  const double far_mm = std::max(distance_mm_, -box_V.min_mm.z()) + margin;
  Mat4 clip = Mat4::Zero();
  clip(0, 0) = 1.0 / half.across;
  clip(1, 1) = 1.0 / half.up;
  clip(2, 2) = -(far_mm + near_mm) / (far_mm - near_mm);
  clip(2, 3) = -2.0 * far_mm * near_mm / (far_mm - near_mm);
  clip(3, 2) = -1.0;
  Mat4 view = Mat4::Identity();
  view.topLeftCorner<3, 3>() = X.linear;
  view.topRightCorner<3, 1>() = X.translation;
  return clip * view;
}

Ray Camera::RayThrough(double x_px, double y_px, const ImageSize& size) const {
  const HalfView half = HalfViewOf(size);
  const double right = (2.0 * x_px / std::max(size.width, 1) - 1.0) * half.across;
  const double up = (1.0 - 2.0 * y_px / std::max(size.height, 1)) * half.up;
  const Mat3 R_DV = X_VD().linear.transpose();
  return {Eye(), (R_DV * Vec3(right, up, -1.0)).normalized()};
}

double Camera::MmPerPixel(const ImageSize& size) const {
  return 2.0 * distance_mm_ * HalfViewOf(size).up / std::max(size.height, 1);
}

Projection::Projection(const Camera& camera, const ImageSize& size)
    : camera_(camera),
      size_{std::max(size.width, 1), std::max(size.height, 1)},
      X_VD_(camera.X_VD()),
      eye_D_(camera.Eye()) {
  const HalfView half = HalfViewOf(size_);
  px_per_slope_ = {0.5 * size_.width / half.across, 0.5 * size_.height / half.up};
}

std::optional<Eigen::Vector2d> Projection::PixelOf(const Vec3& p_D) const {
  const Vec3 p_V = X_VD_.Apply(p_D);
  if (!(-p_V.z() > kNearest_mm)) return std::nullopt;
  return Eigen::Vector2d(0.5 * size_.width - px_per_slope_.x() * p_V.x() / p_V.z(),
                         0.5 * size_.height + px_per_slope_.y() * p_V.y() / p_V.z());
}

double Projection::MmPerPixel(const Vec3& p_D) const {
  return std::max(-X_VD_.Apply(p_D).z(), kNearest_mm) / px_per_slope_.y();
}

Ray Projection::RayThrough(const Eigen::Vector2d& at_px) const {
  return camera_.RayThrough(at_px.x(), at_px.y(), size_);
}

}  // namespace palpate::view
