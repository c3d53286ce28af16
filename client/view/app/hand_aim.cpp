#include "client/view/app/hand_aim.h"

namespace palpate::view {
namespace {

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
                     const HandOptions& options, double harder_mm) {
  const Ray ray = seen.camera.RayThrough(at_px.x(), at_px.y(), view);
  const auto surface_D =
      options.way == HandWay::kSurface ? seen.At(at_px, view) : std::optional<Vec3>();
  plane_D_ = surface_D ? Vec3(*surface_D + options.press_mm * ray.direction)
                       : OnPlane(ray, plane_D_, seen.camera);
  target_D_ = plane_D_ + harder_mm * ray.direction;
}

void HandAim::Push(double farther_mm, const Camera& camera) {
  plane_D_ += farther_mm * Forward(camera);
}

}  // namespace palpate::view
