#include "server/haptics/isovalue_glide.h"

#include <algorithm>

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

// From `last` towards the isovalue of `surface`, both felt on the proxy's side.
double Glide(const HapticSurface& surface, double last, double dt_s, RendererState& state) {
  const Proxy& proxy = state.proxy;
  const Vec3 p_I = surface.X_ID.Apply(proxy.p_DH_mm);
  if (!proxy.on_surface) {
    double density = 0.0;
    PlaceAt(surface, surface.X_LD.Apply(proxy.p_DH_mm), state.cache, density);
    if (density <= surface.isovalue) return surface.isovalue;
  }
  const double rate_per_s =
      std::clamp(kGlideSpeedMmPerS * GradientPerMm(surface, p_I), kMinGlidePerS, kMaxGlidePerS);
  const double step = rate_per_s * std::min(dt_s, kLongestGlideTickS);
  return last + std::clamp(surface.isovalue - last, -step, step);
}

}  // namespace

double GlideIsovalue(const HapticSurface& surface, double dt_s, RendererState& state) noexcept {
  const Proxy& proxy = state.proxy;
  const HapticSurface other = surface.Flipped();
  const HapticSurface& felt = state.popped ? other : surface;
  if (!proxy.placed || proxy.buried || proxy.isovalue == felt.isovalue ||
      proxy.free_side != felt.free_side ||
      proxy.loaded_revision != felt.volume->loaded_revision()) {
    return surface.isovalue;
  }
  const double isovalue = Glide(felt, proxy.isovalue, dt_s, state);
  return state.popped ? -isovalue : isovalue;
}

}  // namespace palpate
