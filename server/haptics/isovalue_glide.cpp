#include "server/haptics/isovalue_glide.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Index coordinates beyond this are not in a volume.
constexpr double kFarthestIndex = 1e6;

// Length of the trilinear density's gradient at p_I, per mm of D; 0 far from the volume.
double GradientPerMm(const HapticSurface& surface, const Vec3& p_I) {
  if (!(p_I.cwiseAbs().maxCoeff() < kFarthestIndex)) return 0.0;
  const Vec3i cell = p_I.array().floor().cast<int>();
  const Trilinear f(surface.volume->StoredCell(cell));
  return (surface.X_ID.linear.transpose() * f.Gradient(p_I - cell.cast<double>())).norm();
}

// The greatest step of an isovalue in this tick.
double StepAt(const HapticSurface& surface, double dt_s, const Proxy& proxy) {
  const Vec3 p_I = surface.X_ID.Apply(proxy.p_DH_mm);
  const double rate_per_s =
      std::clamp(kGlideSpeedMmPerS * GradientPerMm(surface, p_I), kMinGlidePerS, kMaxGlidePerS);
  return rate_per_s * std::min(dt_s, kLongestGlideTickS);
}

double Towards(double asked, double last, double step) {
  if (std::isinf(asked) || std::isinf(last)) return asked;
  return last + std::clamp(asked - last, -step, step);
}

}  // namespace

std::optional<GlidingBounds> Glide(const HapticSurface& surface, double dt_s, const Proxy& proxy,
                                   CellCache& cache) noexcept {
  if (!proxy.placed || proxy.buried ||
      (proxy.isovalue == surface.isovalue && proxy.lower == surface.lower) ||
      proxy.free_side != surface.free_side ||
      proxy.loaded_revision != surface.volume->loaded_revision()) {
    return std::nullopt;
  }
  if (!proxy.on_surface()) {
    double density = 0.0;
    PlaceAt(surface, surface.X_LD.Apply(proxy.p_DH_mm), cache, density);
    if (surface.Holds(density)) return std::nullopt;
  }
  const double step = StepAt(surface, dt_s, proxy);
  const GlidingBounds bounds{Towards(surface.isovalue, proxy.isovalue, step),
                             Towards(surface.lower, proxy.lower, step)};
  if (bounds.isovalue - bounds.lower < kLeastBand) return std::nullopt;
  return bounds;
}

}  // namespace palpate
