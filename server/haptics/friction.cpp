#include "server/haptics/friction.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// A slide shorter than this share of the depth counts as no slide.
constexpr double kNoSlide = 1e-9;

void AddWork(const ProxyStep& other, ProxyStep& step) {
  step.moves += other.moves;
  step.tetrahedra += other.tetrahedra;
  step.capped = step.capped || other.capped;
  if (other.mode == ProxyMode::kEjecting) step.mode = other.mode;
}

// The pull of the HIP on the proxy.
struct Load {
  double along_mm = 0.0;   // the part that H holds
  double across_mm = 0.0;  // the part that H does not hold
  Vec3 normal_D = Vec3::Zero();
};

Load LoadOn(const HapticSurface& surface, const Vec3& p_DHip_mm, const Proxy& proxy,
            CellCache& cache) noexcept {
  const Vec3 free_mm = FreePart(surface, p_DHip_mm, proxy, cache);
  const Vec3 held_mm = p_DHip_mm - proxy.p_DH_mm - free_mm;
  Load load{held_mm.norm(), free_mm.norm(), Vec3::Zero()};
  if (load.along_mm > 0.0) load.normal_D = -held_mm / load.along_mm;
  return load;
}

// The friction of a grain as a share of the normal force.
double GrainShare(const HapticLayer& layer, double slid_mm, double normal_n) {
  if (!(normal_n > 0.0)) return 0.0;
  // Nearly (1 - cos) / 2, by exact arithmetic, so that a replay has the same bits everywhere.
  // The wavelength may just have become shorter.
  const double wavelength_mm = layer.texture_wavelength_mm;
  const double u = std::fmod(slid_mm, wavelength_mm) / wavelength_mm, bump = 4.0 * u * (1.0 - u);
  return std::min(layer.texture_force_n / normal_n, kMostGrain) * bump * bump;
}

// Keeps the proxy at its place on H. If H has moved, the proxy moves with H.
ProxyStep Stay(const HapticSurface& surface, const Vec3& p_DHip_mm, const Vec3& normal_D,
               double eject_limit_mm, Proxy& proxy, CellCache& cache) noexcept {
  const bool was_on_surface = proxy.on_surface();
  const Vec3 stay_mm = proxy.p_DH_mm;
  ProxyStep step = StepProxy(surface, stay_mm, eject_limit_mm, proxy, cache);
  if (was_on_surface && !proxy.on_surface() && !proxy.buried) {
    const double height_mm = std::max(0.0, normal_D.dot(stay_mm - p_DHip_mm));
    DropToSurface(surface, stay_mm - height_mm * normal_D, proxy, cache, step);
  }
  return step;
}

// Moves `proxy`, which does not stick, as far as friction allows.
ProxyStep Slide(const HapticSurface& surface, double kinetic, const Vec3& p_DHip_mm,
                double eject_limit_mm, Proxy& proxy, bool& sticking, CellCache& cache) noexcept {
  const Proxy start = proxy;
  const ProxyStep rest = StepProxy(surface, p_DHip_mm, eject_limit_mm, proxy, cache);
  sticking = false;
  if (!proxy.on_surface()) return rest;
  const Vec3 back_mm = start.p_DH_mm - rest.p_DH_mm;
  const double way_mm = back_mm.norm();
  const double depth_mm = (rest.p_DH_mm - p_DHip_mm).norm();
  sticking = way_mm <= kNoSlide * depth_mm;
  const double lag_mm = std::min(kinetic * depth_mm, way_mm);
  if (sticking || !(lag_mm > 0.0)) return rest;
  proxy = start;
  const Vec3 target_mm = p_DHip_mm + back_mm * (lag_mm / way_mm);
  ProxyStep step = StepProxy(surface, target_mm, eject_limit_mm, proxy, cache);
  AddWork(rest, step);
  if (proxy.on_surface()) step.normal_D = LoadOn(surface, p_DHip_mm, proxy, cache).normal_D;
  return step;
}

}  // namespace

ProxyStep StepWithFriction(const HapticSurface& surface, const HapticLayer& layer,
                           const Vec3& p_DHip_mm, double eject_limit_mm, Proxy& proxy,
                           FrictionState& state, CellCache& cache) noexcept {
  if (!layer.has_friction() || !proxy.placed || proxy.buried) {
    state = {};
    return StepProxy(surface, p_DHip_mm, eject_limit_mm, proxy, cache);
  }
  ProxyStep kept = Stay(surface, p_DHip_mm, state.normal_D, eject_limit_mm, proxy, cache);
  if (!proxy.on_surface()) {
    ProxyStep step = StepProxy(surface, p_DHip_mm, eject_limit_mm, proxy, cache);
    AddWork(kept, step);
    // A proxy that touches H sticks at first.
    state = {proxy.on_surface(), step.normal_D, 0.0};
    return step;
  }
  const Load load = LoadOn(surface, p_DHip_mm, proxy, cache);
  const bool has_grain = layer.texture_force_n > 0.0;
  double kinetic = layer.dynamic_friction;
  if (has_grain) {
    kinetic += GrainShare(layer, state.slid_mm, layer.stiffness_n_per_mm * load.along_mm);
  }
  const double hold = std::max(layer.static_friction, kinetic);
  if (load.along_mm > 0.0 && load.across_mm <= (state.sticking ? hold : kinetic) * load.along_mm) {
    state = {true, load.normal_D, state.slid_mm};
    kept.normal_D = load.normal_D;
    if (kept.mode == ProxyMode::kFree) kept.mode = ProxyMode::kConstrained;
    return kept;
  }
  const Vec3 from_mm = proxy.p_DH_mm;
  ProxyStep step = Slide(surface, kinetic, p_DHip_mm, eject_limit_mm, proxy, state.sticking, cache);
  if (has_grain) {
    const double way_mm = state.slid_mm + (step.p_DH_mm - from_mm).norm();
    state.slid_mm = std::fmod(way_mm, layer.texture_wavelength_mm);
  }
  AddWork(kept, step);
  state.normal_D = step.normal_D;
  return step;
}

}  // namespace palpate
