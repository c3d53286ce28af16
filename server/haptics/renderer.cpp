#include "server/haptics/renderer.h"

#include <algorithm>
#include <numbers>

namespace palpate {
namespace {

// Positions beyond this are no positions.
constexpr double kMaxHipMm = 1e6;
// The damper must not follow the steps of the device's resolution.
constexpr double kVelocityCutoffHz = 40.0;

bool IsPosition(const Vec3& p) { return p.allFinite() && p.cwiseAbs().maxCoeff() < kMaxHipMm; }

void TrackHip(const Vec3& p_DHip_mm, double dt_s, RendererState& state) {
  if (state.has_hip && dt_s > 0.0) {
    const Vec3 velocity = (p_DHip_mm - state.p_DHip_mm) / dt_s;
    const double share = std::min(1.0, 2.0 * std::numbers::pi * kVelocityCutoffHz * dt_s);
    state.velocity_mm_per_s += share * (velocity - state.velocity_mm_per_s);
  }
  state.p_DHip_mm = p_DHip_mm;
  state.has_hip = true;
}

// Spring to the proxy; the damper acts along the normal and never pulls inwards.
Vec3 ContactForce(const HapticSettings& settings, const ProxyStep& step,
                  const RendererState& state) {
  const Vec3 push_mm = step.p_DH_mm - state.p_DHip_mm;
  const double spring_n = settings.stiffness_n_per_mm * push_mm.norm();
  const double mm_per_m = 1000.0;
  const double damper_n =
      -settings.damping_n_s_per_m / mm_per_m * state.velocity_mm_per_s.dot(step.normal_D);
  // At most as much as the spring, so that the force stays continuous at contact.
  return step.normal_D * (spring_n + std::clamp(damper_n, -spring_n, spring_n));
}

}  // namespace

HapticOutput StepRenderer(const HapticSurface& surface, const HapticSettings& settings,
                          const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept {
  HapticOutput output;
  if (IsPosition(p_DHip_mm)) {
    TrackHip(p_DHip_mm, dt_s, state);
  } else {
    output.input_rejected = true;
    if (!state.has_hip) return output;
  }
  output.p_DHip_mm = state.p_DHip_mm;
  const double eject_limit_mm = settings.stiffness_n_per_mm > 0.0
                                    ? kEjectForceLimitN / settings.stiffness_n_per_mm
                                    : kMaxHipMm;
  output.proxy = StepProxy(surface, state.p_DHip_mm, eject_limit_mm, state.proxy, state.cache);
  if (state.proxy.on_surface) {
    output.spring_D_n = settings.stiffness_n_per_mm * (output.proxy.p_DH_mm - state.p_DHip_mm);
    output.force_D_n = ContactForce(settings, output.proxy, state);
    output.visual = FindVisualProxy(surface, state.proxy.place, output.proxy.normal_D, state.cache);
  }
  return output;
}

}  // namespace palpate
