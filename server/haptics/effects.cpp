#include "server/haptics/effects.h"

#include <algorithm>

#include "server/haptics/nearest_point.h"

namespace palpate {
namespace {

constexpr double kMmPerM = 1000.0;

// Turns v as the least rotation from one unit vector to another does (Rodrigues). The two vectors
// are not opposite: a shaded normal is at most kMaxShadingAngleRad away. Eigen's
// Quaternion::FromTwoVectors also handles opposite ones, and takes 15 s to compile for them.
Vec3 TurnedFromTo(const Vec3& from, const Vec3& to, const Vec3& v) {
  const Vec3 axis = from.cross(to);
  const double cosine = from.dot(to);
  return cosine * v + axis.cross(v) + axis.dot(v) / (1.0 + cosine) * axis;
}

}  // namespace

Vec3 ContactForce(const HapticLayer& layer, const ProxyStep& step, const Vec3& normal_D,
                  const Vec3& spring_D_n, const Vec3& velocity_mm_per_s) noexcept {
  const double spring_n = std::max(0.0, spring_D_n.dot(step.normal_D));
  const double damper_n = -layer.damping_n_s_per_m / kMmPerM * velocity_mm_per_s.dot(normal_D);
  // Limited to the spring's force, so that the force stays continuous at contact.
  const Vec3 force = (spring_n + std::clamp(damper_n, -spring_n, spring_n)) * normal_D;
  if (!layer.has_friction()) return force;
  const Vec3 lean = spring_D_n - spring_D_n.dot(step.normal_D) * step.normal_D;
  return force + TurnedFromTo(step.normal_D, normal_D, lean);
}

Vec3 ViscousForce(double viscosity_n_s_per_m, const Vec3& velocity_mm_per_s) noexcept {
  return -viscosity_n_s_per_m / kMmPerM * velocity_mm_per_s;
}

Vec3 MagneticForce(const HapticSurface& surface, const HapticSettings& settings, const Vec3& p_D,
                   CellCache& cache) noexcept {
  if (!(settings.magnet_force_n > 0.0 && settings.magnet_range_mm > 0.0)) return Vec3::Zero();
  const double range_mm = std::min(settings.magnet_range_mm, MaxNearestMm(surface));
  const auto nearest = NearestPointOnSurface(surface, p_D, range_mm, cache);
  if (!nearest) return Vec3::Zero();
  const Vec3 way_mm = *nearest - p_D;
  const double share = way_mm.norm() / range_mm;
  if (!(share > 0.0)) return Vec3::Zero();
  // The force is 4 share (1 - share) along the unit way.
  return way_mm * (settings.magnet_force_n * 4.0 * (1.0 - share) / range_mm);
}

}  // namespace palpate
