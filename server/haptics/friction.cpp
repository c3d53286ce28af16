#include "server/haptics/friction.h"

#include <algorithm>

namespace palpate {
namespace {

void AddWork(const ProxyStep& other, ProxyStep& step) {
  step.moves += other.moves;
  step.tetrahedra += other.tetrahedra;
  step.capped = step.capped || other.capped;
}

}  // namespace

ProxyStep StepWithFriction(const HapticSurface& surface, const HapticSettings& settings,
                           const Vec3& p_DHip_mm, double eject_limit_mm, Proxy& proxy,
                           bool& sticking, CellCache& cache) noexcept {
  const double kinetic = settings.dynamic_friction;
  const double hold = std::max(settings.static_friction, kinetic);
  if (!(hold > 0.0) || !proxy.placed || proxy.buried) {
    sticking = false;
    return StepProxy(surface, p_DHip_mm, eject_limit_mm, proxy, cache);
  }
  // Carried with the surface where that has changed, but not on.
  const Vec3 stay_mm = proxy.p_DH_mm;
  const ProxyStep kept = StepProxy(surface, stay_mm, eject_limit_mm, proxy, cache);
  const Proxy start = proxy;
  ProxyStep step = StepProxy(surface, p_DHip_mm, eject_limit_mm, proxy, cache);
  AddWork(kept, step);
  if (kept.mode == ProxyMode::kEjecting) step.mode = kept.mode;
  if (!start.on_surface || !proxy.on_surface || proxy.buried) {
    sticking = proxy.on_surface;  // what it touches, it touches at rest
    return step;
  }
  const Vec3 back_mm = start.p_DH_mm - step.p_DH_mm;
  const double way_mm = back_mm.norm();
  const double depth_mm = (step.p_DH_mm - p_DHip_mm).norm();
  sticking = way_mm <= (sticking ? hold : kinetic) * depth_mm;
  if (!(way_mm > 0.0)) return step;
  const Vec3 target_mm =
      sticking ? start.p_DH_mm : Vec3(p_DHip_mm + back_mm * (kinetic * depth_mm / way_mm));
  proxy = start;
  ProxyStep held = StepProxy(surface, target_mm, eject_limit_mm, proxy, cache);
  AddWork(step, held);
  held.mode = step.mode;
  held.normal_D = step.normal_D;
  return held;
}

}  // namespace palpate
