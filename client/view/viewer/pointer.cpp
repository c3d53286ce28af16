#include "client/view/viewer/pointer.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace palpate::view {
namespace {

constexpr double kStep_px = 2.0;
// If the depth changes this many times more than next to it, there is an edge and not a slope.
constexpr double kSteepest = 4.0;

}  // namespace

std::optional<Vec3> SeenSurface::At(const Eigen::Vector2d& point_px, const ImageSize& view) const {
  const int x = static_cast<int>(std::floor(point_px.x() * size.width / view.width));
  const int y = static_cast<int>(std::floor(point_px.y() * size.height / view.height));
  if (x < 0 || y < 0 || x >= size.width || y >= size.height) return std::nullopt;
  const std::size_t n = static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) +
                        static_cast<std::size_t>(x);
  if (n >= distances_mm.size() || !std::isfinite(distances_mm[n])) return std::nullopt;
  const Ray ray = camera.RayThrough(x + 0.5, y + 0.5, size);
  return Vec3(ray.origin + static_cast<double>(distances_mm[n]) * ray.direction);
}

bool PointerStroke::Begin(SeenSurface surface, const Eigen::Vector2d& at_px, const ImageSize& view,
                          double jump_mm, const Sink& sink) {
  const std::optional<Vec3> p_D = surface.At(at_px, view);
  if (!p_D) return false;
  has_pointer_ = true;
  surface_ = std::move(surface);
  jump_mm_ = jump_mm;
  at_px_ = at_px;
  since_step_px_ = 0.0;
  last_D_ = p_D;
  sink.draw(*p_D);
  return true;
}

void PointerStroke::MoveTo(const Eigen::Vector2d& at_px, const ImageSize& view, const Sink& sink) {
  if (!surface_) return;
  const Eigen::Vector2d from_px = std::exchange(at_px_, at_px);
  const double way_px = (at_px - from_px).norm();
  double next_px = kStep_px - since_step_px_;
  for (; next_px <= way_px; next_px += kStep_px) {
    Draw(from_px + (at_px - from_px) * (next_px / way_px), view, sink);
  }
  since_step_px_ = way_px - (next_px - kStep_px);
}

void PointerStroke::Draw(const Eigen::Vector2d& at_px, const ImageSize& view, const Sink& sink) {
  const std::optional<Vec3> p_D = surface_->At(at_px, view);
  if (!p_D) {
    if (last_D_) sink.lift();
    last_D_.reset();
    return;
  }
  if (last_D_) {
    const Vec3 eye_D = surface_->camera.Eye();
    const double last_mm = (*last_D_ - eye_D).norm();
    const double farther_mm = std::abs((*p_D - eye_D).norm() - last_mm);
    const double beside_mm = (*last_D_ - eye_D - last_mm * (*p_D - eye_D).normalized()).norm();
    if (farther_mm > std::max(jump_mm_, kSteepest * beside_mm)) sink.lift();
  }
  last_D_ = p_D;
  sink.draw(*p_D);
}

void PointerStroke::Release() {
  has_pointer_ = false;
  surface_.reset();
  last_D_.reset();
}

namespace {

// The direction from the middle of the volume; any if the place is the middle.
Vec3 Outwards(const Vec3& p_D, const Surroundings& volume) {
  const Vec3 out = p_D - volume.center_D;
  return out.norm() > 1e-9 ? Vec3(out.normalized()) : Vec3::UnitZ();
}

// Where the line of sight comes into the ball; the eye if it is within.
Vec3 Entrance(const Vec3& target_D, const Vec3& eye_D, const Surroundings& volume) {
  const Vec3 from_eye = target_D - eye_D;
  const double length_mm = from_eye.norm();
  if (length_mm < 1e-9) return eye_D;
  const Vec3 to_center = volume.center_D - eye_D;
  const double middle_mm = to_center.dot(from_eye) / length_mm;
  const double aside_mm2 = to_center.squaredNorm() - middle_mm * middle_mm;
  const double half_mm2 = volume.radius_mm * volume.radius_mm - aside_mm2;
  const double first_mm = half_mm2 > 0.0 ? middle_mm - std::sqrt(half_mm2) : middle_mm;
  return eye_D + std::clamp(first_mm, 0.0, length_mm) / length_mm * from_eye;
}

// The camera looks along its -z.
Vec3 Forward(const Camera& camera) { return -camera.X_VD().linear.row(2).transpose(); }

// Where a ray meets the plane through `p_D` across the line of sight. A plane at or behind the eye
// has no such point; the plane through the camera's target is taken instead.
Vec3 OnPlane(const Ray& ray, const Vec3& p_D, const Camera& camera) {
  constexpr double kLeastDepth_mm = 0.1;
  const Vec3 forward = Forward(camera);
  double depth_mm = forward.dot(p_D - ray.origin);
  if (!(depth_mm > kLeastDepth_mm)) depth_mm = camera.distance_mm();
  return ray.origin + depth_mm / forward.dot(ray.direction) * ray.direction;
}

}  // namespace

void HandAim::Follow(const Eigen::Vector2d& at_px, const ImageSize& view, const SeenSurface& seen,
                     const HandOptions& options, double tip_mm) {
  const Ray ray = seen.camera.RayThrough(at_px.x(), at_px.y(), view);
  const auto surface_D =
      options.way == HandWay::kSurface ? seen.At(at_px, view) : std::optional<Vec3>();
  plane_D_ = surface_D ? Vec3(*surface_D + (options.press_mm - tip_mm) * ray.direction)
                       : OnPlane(ray, plane_D_, seen.camera);
  sight_D_ = ray.direction;
}

std::vector<Vec3> WayAround(const Vec3& from_D, const Vec3& target_D, const Vec3& eye_D,
                            const Surroundings& volume) {
  constexpr double kStep = std::numbers::pi / 12.0;
  const Vec3 entrance_D = Entrance(target_D, eye_D, volume);
  const Vec3 first = Outwards(from_D, volume);
  const Vec3 last = Outwards(entrance_D, volume);
  Vec3 axis = first.cross(last);
  axis = axis.norm() > 1e-6 ? Vec3(axis.normalized()) : Vec3(first.unitOrthogonal());
  const double angle = std::atan2(first.cross(last).norm(), first.dot(last));
  const int steps = std::max(1, static_cast<int>(std::ceil(angle / kStep)));
  std::vector<Vec3> way_D;
  for (int n = 0; n <= steps; ++n) {
    way_D.push_back(volume.center_D +
                    volume.radius_mm * (Eigen::AngleAxisd(angle * n / steps, axis) * first));
  }
  way_D.push_back(entrance_D);
  way_D.push_back(target_D);
  return way_D;
}

Vec3 GoAlong(std::vector<Vec3>& way_D, const Vec3& from_D, double length_mm) {
  Vec3 at_D = from_D;
  std::size_t gone = 0;
  for (; gone < way_D.size(); ++gone) {
    const Vec3 to_next = way_D[gone] - at_D;
    const double next_mm = to_next.norm();
    if (next_mm > length_mm) {
      at_D += length_mm / next_mm * to_next;
      break;
    }
    length_mm -= next_mm;
    at_D = way_D[gone];
  }
  way_D.erase(way_D.begin(), way_D.begin() + static_cast<std::ptrdiff_t>(gone));
  return at_D;
}

void HandAim::Push(double farther_mm, const Camera& camera) {
  plane_D_ += farther_mm * Forward(camera);
}

}  // namespace palpate::view
