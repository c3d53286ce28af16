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

// A position beyond this is invalid.
constexpr double kMaxHipMm = 1e6;
// The damper must not follow the steps of the device's resolution.
constexpr double kVelocityCutoffHz = 40.0;

bool IsPosition(const Vec3& p) { return p.allFinite() && p.cwiseAbs().maxCoeff() < kMaxHipMm; }

void TrackHip(const Vec3& p_DHip_mm, double since_s, RendererState& state) {
  // If positions were rejected, the way since the last good one took longer.
  const double dt_s = since_s + state.rejected_s;
  state.rejected_s = 0.0;
  if (state.has_hip && dt_s > 0.0) {
    const Vec3 velocity = (p_DHip_mm - state.p_DHip_mm) / dt_s;
    const double share = std::min(1.0, 2.0 * std::numbers::pi * kVelocityCutoffHz * dt_s);
    state.velocity_mm_per_s += share * (velocity - state.velocity_mm_per_s);
  }
  state.p_DHip_mm = p_DHip_mm;
  state.has_hip = true;
}

// One haptic update in progress.
class Update {
 public:
  Update(const HapticSurface& surface, const HapticSettings& settings, double dt_s,
         RendererState& state, HapticOutput& output)
      : surface_(surface), settings_(settings), dt_s_(dt_s), state_(state), output_(output) {}

  void Run() noexcept {
    const bool penetrable = settings_.pop_force_n > 0.0;
    if (!penetrable || IsOnOwnSideOfNewVolume()) state_.popped = false;
    ChooseSide();
    const double budget_mj = EnergyOfTheMove();
    StepOnBothSides(penetrable);
    state_.limited_D_n = LimitedForce(budget_mj);
    const Vec3 pop_D_n = FadingPop();
    state_.felt_D_n = state_.limited_D_n + pop_D_n;
    state_.by_design_D_n = pop_D_n + Magnet();
    output_.force_D_n = state_.limited_D_n + state_.by_design_D_n;
  }

 private:
  // The stylus feels a new volume from the side that the HIP is on.
  bool IsOnOwnSideOfNewVolume() noexcept {
    if (!state_.popped || state_.proxy.geometry_revision == surface_.geometry_revision) {
      return false;
    }
    double density = 0.0;
    PlaceAt(surface_, surface_.X_LD.Apply(state_.p_DHip_mm), state_.cache, density);
    return density <= surface_.isovalue;
  }

  // The energy that the spring gained because the surface moved: with the HIP at its old place, the
  // energy on the present surface minus that on the old one.
  double EnergyOfTheMove() noexcept {
    const Proxy& proxy = state_.proxy;
    const bool same = proxy.geometry_revision == felt().geometry_revision &&
                      proxy.refinement == felt().lattice.refinement() &&
                      proxy.volume_revision == felt().volume->revision() &&
                      proxy.free_side == felt().free_side && proxy.isovalue == felt().isovalue;
    if (same || !settings_.passivity_control || !proxy.placed) return 0.0;
    Proxy probe = proxy;
    StepProxy(felt(), state_.p_DLastHip_mm, EjectLimit(), probe, state_.cache);
    const double depth_mm = probe.on_surface ? (probe.p_DH_mm - state_.p_DLastHip_mm).norm() : 0.0;
    return std::max(0.0, SpringEnergy(depth_mm) - state_.spring_mj);
  }

  double SpringEnergy(double depth_mm) const {
    return 0.5 * settings_.stiffness_n_per_mm * depth_mm * depth_mm;
  }

  double EjectLimit() const {
    return settings_.stiffness_n_per_mm > 0.0 ? kEjectForceLimitN / settings_.stiffness_n_per_mm
                                              : kMaxHipMm;
  }

  // Uses the settings' side, or the other one after a pop.
  void ChooseSide() noexcept {
    flipped_.reset();
    if (state_.popped) flipped_ = surface_.Flipped();
  }
  const HapticSurface& felt() const { return flipped_ ? *flipped_ : surface_; }

  void Step() noexcept {
    output_.proxy = StepWithFriction(felt(), settings_, state_.p_DHip_mm, EjectLimit(),
                                     state_.proxy, state_.friction, state_.cache);
    output_.spring_D_n =
        state_.proxy.on_surface
            ? Vec3(settings_.stiffness_n_per_mm * (output_.proxy.p_DH_mm - state_.p_DHip_mm))
            : Vec3::Zero();
  }

  void StepOnBothSides(bool penetrable) noexcept {
    Step();
    output_.popped = penetrable && output_.spring_D_n.norm() > settings_.pop_force_n;
    // Without a surface to hold it, the proxy is free on the HIP's side.
    if (output_.popped || (penetrable && state_.proxy.buried)) {
      const ProxyStep first = output_.proxy;
      state_.popped = !state_.popped;
      state_.proxy.buried = false;
      ChooseSide();
      Step();
      output_.proxy.moves += first.moves;
      output_.proxy.tetrahedra += first.tetrahedra;
    }
    output_.free_side = felt().free_side;
  }

  Vec3 Normal() noexcept {
    if (!settings_.force_shading) return output_.proxy.normal_D;
    const Vec3 p_LH = PlaceLatticePosition(felt(), state_.proxy.place, state_.cache);
    return ShadedNormal(felt(), felt().lattice.ToVoxels(p_LH), output_.proxy.normal_D);
  }

  // The forces against the hand, without the effects that add energy by design.
  Vec3 LimitedForce(double budget_mj) noexcept {
    Vec3 force = ViscousForce(settings_, state_.velocity_mm_per_s);
    double depth_mm = 0.0;
    if (state_.proxy.on_surface) {
      force += ContactForce(settings_, output_.proxy, Normal(), output_.spring_D_n,
                            state_.velocity_mm_per_s);
      depth_mm = (output_.proxy.p_DH_mm - state_.p_DHip_mm).norm();
    }
    state_.spring_mj = SpringEnergy(depth_mm);
    if (!settings_.passivity_control) {
      if (state_.passivity.started) state_.passivity = PassivityState();
      return force;
    }
    return LimitToPassive(force, settings_.stiffness_n_per_mm, depth_mm, state_.p_DHip_mm,
                          budget_mj, dt_s_, state_.device, state_.passivity);
  }

  // In the tick of the pop the force stays as it was. It fades from there.
  Vec3 FadingPop() noexcept {
    if (output_.popped) {
      state_.pop_force_D_n = state_.felt_D_n - state_.limited_D_n;
      state_.pop_fade = 1.0;
    }
    const Vec3 force = state_.pop_fade * state_.pop_force_D_n;
    state_.pop_fade = std::max(0.0, state_.pop_fade - dt_s_ / kPopFadeS);
    return force;
  }

  Vec3 Magnet() noexcept {
    if (state_.proxy.on_surface || state_.proxy.buried) return Vec3::Zero();
    if (!(settings_.magnet_force_n > 0.0)) return Vec3::Zero();
    // Sub-cells would be too many to search in a tick, and no hand tells their magnet from this
    // one.
    HapticSurface whole_cells = felt();
    whole_cells.Refine(1);
    return MagneticForce(whole_cells, settings_, state_.p_DHip_mm, *state_.magnet_cache);
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
    state.rejected_s += dt_s;
    if (!state.has_hip) return output;
  }
  output.p_DHip_mm = state.p_DHip_mm;
  Update(surface, settings, dt_s, state, output).Run();
  state.p_DLastHip_mm = state.p_DHip_mm;
  return output;
}

VisualProxy VisualProxyOf(const HapticSurface& surface, const HapticOutput& output,
                          RendererState& state) noexcept {
  const Proxy& proxy = state.proxy;
  if (!proxy.on_surface) return {};
  return FindVisualProxy(proxy.free_side == surface.free_side ? surface : surface.Flipped(),
                         proxy.place, output.proxy.normal_D, state.cache);
}

HapticOutput SuspendRenderer(const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept {
  HapticOutput output;
  output.input_rejected = !IsPosition(p_DHip_mm);
  if (output.input_rejected) {
    state.rejected_s += dt_s;
  } else {
    TrackHip(p_DHip_mm, dt_s, state);
  }
  output.p_DHip_mm = output.proxy.p_DH_mm = state.p_DLastHip_mm = state.p_DHip_mm;
  state.proxy = Proxy();
  state.friction = FrictionState();
  state.passivity = PassivityState();
  state.popped = false;
  state.pop_fade = state.spring_mj = 0.0;
  state.felt_D_n = state.limited_D_n = state.by_design_D_n = Vec3::Zero();
  return output;
}

void TellWrittenForce(const Vec3& written_D_n, RendererState& state) noexcept {
  if (!state.passivity.started) return;
  // A limit's reduction is split between both parts in proportion.
  const double limited_n = state.limited_D_n.norm(), designed_n = state.by_design_D_n.norm();
  const double share = designed_n > 0.0 ? limited_n / (limited_n + designed_n) : 1.0;
  const Vec3 lost_D_n = state.limited_D_n + state.by_design_D_n - written_D_n;
  state.passivity.written_D_n.col(0) = state.limited_D_n - share * lost_D_n;
}

}  // namespace palpate
