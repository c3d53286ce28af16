#include "server/haptics/renderer.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "server/haptics/effects.h"
#include "server/haptics/force_shading.h"
#include "server/haptics/friction.h"

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

// One haptic update on its way.
class Update {
 public:
  Update(const HapticSurface& surface, const HapticSettings& settings, double dt_s,
         RendererState& state, HapticOutput& output)
      : surface_(surface), settings_(settings), dt_s_(dt_s), state_(state), output_(output) {}

  void Run() noexcept {
    const bool moved = !IsSameSurface();
    StepOnBothSides();
    const Vec3 limited_D_n = LimitedForce(moved);
    state_.by_design_D_n = MagnetAndPop();
    output_.force_D_n = limited_D_n + state_.by_design_D_n;
    if (!state_.proxy.on_surface) return;
    output_.visual =
        FindVisualProxy(felt(), state_.proxy.place, output_.proxy.normal_D, state_.cache);
  }

 private:
  bool IsSameSurface() const {
    return state_.proxy.geometry_revision == surface_.geometry_revision &&
           std::abs(state_.proxy.isovalue) == std::abs(surface_.isovalue);
  }

  // The side that the settings name, or after a pop the other one.
  void ChooseSide() noexcept {
    flipped_.reset();
    if (state_.popped) flipped_ = surface_.Flipped();
  }
  const HapticSurface& felt() const { return flipped_ ? *flipped_ : surface_; }

  void Step() noexcept {
    const double eject_limit_mm = settings_.stiffness_n_per_mm > 0.0
                                      ? kEjectForceLimitN / settings_.stiffness_n_per_mm
                                      : kMaxHipMm;
    output_.proxy = StepWithFriction(felt(), settings_, state_.p_DHip_mm, eject_limit_mm,
                                     state_.proxy, state_.sticking, state_.cache);
    output_.spring_D_n =
        state_.proxy.on_surface
            ? Vec3(settings_.stiffness_n_per_mm * (output_.proxy.p_DH_mm - state_.p_DHip_mm))
            : Vec3::Zero();
  }

  void StepOnBothSides() noexcept {
    const bool penetrable = settings_.pop_force_n > 0.0;
    state_.popped = state_.popped && penetrable;
    ChooseSide();
    Step();
    // Without a surface to hold it, the proxy is free on the side that the HIP is on.
    const bool pops = penetrable && output_.spring_D_n.norm() > settings_.pop_force_n;
    if (pops || (penetrable && state_.proxy.buried)) ChangeSide();
    output_.popped = pops;
    output_.free_side = felt().free_side;
  }

  void ChangeSide() noexcept {
    const Vec3 before_D_n = output_.spring_D_n + state_.pop_fade * state_.pop_force_D_n;
    const ProxyStep first = output_.proxy;
    state_.popped = !state_.popped;
    state_.proxy.buried = false;
    ChooseSide();
    Step();
    output_.proxy.moves += first.moves;
    output_.proxy.tetrahedra += first.tetrahedra;
    state_.pop_force_D_n = before_D_n - output_.spring_D_n;
    state_.pop_fade = 1.0;
  }

  Vec3 Normal() noexcept {
    if (!settings_.force_shading) return output_.proxy.normal_D;
    const Vec3 p_IH = PlaceIndexPosition(felt(), state_.proxy.place, state_.cache);
    return ShadedNormal(felt(), p_IH, output_.proxy.normal_D);
  }

  // What acts against the hand, without what brings energy in by design.
  Vec3 LimitedForce(bool surface_moved) noexcept {
    Vec3 force = ViscousForce(settings_, state_.velocity_mm_per_s);
    double depth_mm = 0.0;
    if (state_.proxy.on_surface) {
      force += ContactForce(settings_, output_.proxy, Normal(), output_.spring_D_n,
                            state_.velocity_mm_per_s);
      depth_mm = (output_.proxy.p_DH_mm - state_.p_DHip_mm).norm();
    }
    const double spring_mj = 0.5 * settings_.stiffness_n_per_mm * depth_mm * depth_mm;
    const bool given =
        surface_moved || output_.popped || output_.proxy.mode == ProxyMode::kEjecting;
    const double budget_mj = given ? std::max(0.0, spring_mj - state_.spring_mj) : 0.0;
    state_.spring_mj = spring_mj;
    if (!settings_.passivity_control) {
      if (state_.passivity.started) state_.passivity = PassivityState();
      return force;
    }
    return LimitToPassive(force, settings_.stiffness_n_per_mm, depth_mm, state_.p_DHip_mm,
                          budget_mj, dt_s_, state_.passivity);
  }

  Vec3 MagnetAndPop() noexcept {
    Vec3 force = state_.pop_fade * state_.pop_force_D_n;
    state_.pop_fade = std::max(0.0, state_.pop_fade - dt_s_ / kPopFadeS);
    if (!state_.proxy.on_surface && !state_.proxy.buried) {
      force += MagneticForce(felt(), settings_, state_.p_DHip_mm, state_.cache);
    }
    return force;
  }

  const HapticSurface& surface_;
  const HapticSettings& settings_;
  const double dt_s_;
  RendererState& state_;
  HapticOutput& output_;
  std::optional<HapticSurface> flipped_;
};

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
  Update(surface, settings, dt_s, state, output).Run();
  return output;
}

void TellWrittenForce(const Vec3& written_D_n, RendererState& state) noexcept {
  if (!state.passivity.started) return;
  state.passivity.written_D_n.col(0) = written_D_n - state.by_design_D_n;
}

}  // namespace palpate
