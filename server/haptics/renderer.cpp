#include "server/haptics/renderer.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>

#include "server/haptics/effects.h"
#include "server/haptics/friction.h"
#include "server/haptics/isovalue_glide.h"
#include "server/haptics/moves.h"

namespace palpate {
namespace {

// A position beyond this is invalid.
constexpr double kMaxHipMm = 1e6;
// The damper must not follow the steps of the device's resolution.
constexpr double kVelocityCutoffHz = 40.0;

bool IsPosition(const Vec3& p) { return p.allFinite() && p.cwiseAbs().maxCoeff() < kMaxHipMm; }

// The layers of a surface.
template <bool kLayered>
class Layers {
 public:
  Layers(const HapticSurface& surface, const HapticSettings&) : layers_(surface.layers->all()) {}
  int count() const { return static_cast<int>(layers_.size()); }
  const HapticLayer& operator[](int n) const { return layers_[static_cast<std::size_t>(n)]; }

 private:
  std::span<const HapticLayer> layers_;
};

// The one surface of settings without layers.
template <>
class Layers<false> {
 public:
  Layers(const HapticSurface& surface, const HapticSettings& settings)
      : one_{.isovalue = surface.isovalue,
             .stiffness_n_per_mm = settings.stiffness_n_per_mm,
             .damping_n_s_per_m = settings.damping_n_s_per_m,
             .static_friction = settings.static_friction,
             .dynamic_friction = settings.dynamic_friction,
             .pop_in_n = settings.pop_force_n,
             .pop_out_n = settings.pop_force_n,
             .viscosity_n_s_per_m = settings.viscosity_n_s_per_m,
             .texture_force_n = settings.texture_force_n,
             .texture_wavelength_mm = settings.texture_wavelength_mm} {}
  static constexpr int count() { return 1; }
  const HapticLayer& operator[](int) const { return one_; }

 private:
  HapticLayer one_;
};

// One haptic update in progress. The one surface has code of its own: layers would cost it 4 % of a
// tick.
template <bool kLayered>
class Update {
 public:
  Update(const HapticSurface& surface, const HapticSettings& settings, double dt_s,
         RendererState& state, HapticOutput& output)
      : surface_(surface),
        settings_(settings),
        dt_s_(dt_s),
        state_(state),
        output_(output),
        layers_(surface, settings) {}

  void Run() noexcept {
    ChooseBand();
    const double budget_mj = EnergyOfTheMove();
    StepAndPop();
    state_.limited_D_n = LimitedForce(budget_mj);
    const Vec3 pop_D_n = FadingPop();
    state_.felt_D_n = state_.limited_D_n + pop_D_n;
    state_.by_design_D_n = pop_D_n + Magnet();
    output_.force_D_n = state_.limited_D_n + state_.by_design_D_n;
    Tell();
  }

 private:
  // --- The band between two layers that the proxy is in

  const HapticSurface& felt() const { return band_ ? *band_ : surface_; }
  HapticSurface& band() noexcept { return band_ ? *band_ : band_.emplace(surface_); }
  int count() const { return layers_.count(); }
  double Lower(int passed) const { return passed > 0 ? layers_[passed - 1].isovalue : -kUnbounded; }
  double Upper(int passed) const {
    return passed < count() ? layers_[passed].isovalue : kUnbounded;
  }

  // A layer that cannot be passed any more holds the stylus from outside again.
  bool MayPass(int layer) const { return layers_[layer].pop_in_n > 0.0; }

  void FollowPassed() noexcept {
    while (passed_ < count() && MayPass(passed_) && (state_.passed & layers_[passed_].bit()) != 0) {
      ++passed_;
    }
  }

  void ChooseBand() noexcept {
    if (state_.passed != 0) FollowPassed();
    if (kLayered || passed_ > 0) {
      band().lower = Lower(passed_);
      band().isovalue = Upper(passed_);
    }
    if (state_.glides) {
      if (const auto bounds = Glide(felt(), dt_s_, state_.proxy, state_.cache)) {
        band().lower = bounds->lower;
        band().isovalue = bounds->isovalue;
      }
    }
    // In a new volume the stylus is no deeper than where the HIP is. The one surface lets go in a
    // new place, too, as in old recordings.
    const Proxy& proxy = state_.proxy;
    const bool is_other = kLayered ? proxy.loaded_revision != surface_.volume->loaded_revision()
                                   : proxy.geometry_revision != surface_.geometry_revision;
    if (passed_ > 0 && is_other) {
      double density = 0.0;
      PlaceAt(felt(), surface_.X_LD.Apply(state_.p_DHip_mm), state_.cache, density);
      while (passed_ > 0 && density <= felt().lower) Pass(-1);
    }
  }

  // Goes on to the next band (1) or back to the last one (-1). The bound between them stays where
  // it is: it may be gliding.
  void Pass(int way) noexcept {
    HapticSurface& surface = band();
    passed_ += way;
    if (way > 0) {
      surface.lower = surface.isovalue;
      surface.isovalue = Upper(passed_);
    } else {
      surface.isovalue = surface.lower;
      surface.lower = Lower(passed_);
    }
  }

  // The bound in contact; without contact that of the next layer inwards, or of the last one.
  Contact Faced(Contact contact) const {
    const bool is_lower = passed_ > 0 && (contact == Contact::kLower || passed_ == count());
    return is_lower ? Contact::kLower : Contact::kUpper;
  }
  const HapticLayer& At(Contact bound) const {
    return layers_[kLayered && Faced(bound) == Contact::kLower ? passed_ - 1 : passed_];
  }
  const HapticLayer& Touched() const { return At(state_.proxy.contact); }

  // --- Steps and pops

  // The energy that the spring gained because the surface moved: with the HIP at its old place, the
  // energy on the present surface minus that on the old one.
  double EnergyOfTheMove() noexcept {
    const Proxy& proxy = state_.proxy;
    if (!settings_.passivity_control || !proxy.placed) return 0.0;
    const bool same = proxy.geometry_revision == felt().geometry_revision &&
                      proxy.refinement == felt().lattice.refinement() &&
                      proxy.volume_revision == felt().volume->revision() &&
                      proxy.free_side == felt().free_side && proxy.isovalue == felt().isovalue &&
                      proxy.lower == felt().lower;
    if (same) return 0.0;
    Proxy probe = proxy;
    StepProxy(felt(), state_.p_DLastHip_mm, EjectLimit(), probe, state_.cache);
    if (!probe.on_surface()) return 0.0;
    const double depth_mm =
        std::max(0.0, (probe.p_DH_mm - state_.p_DLastHip_mm).norm() - state_.slack_mm);
    return std::max(0.0, SpringEnergy(At(probe.contact), depth_mm) - state_.spring_mj);
  }

  static double SpringEnergy(const HapticLayer& layer, double depth_mm) {
    return 0.5 * layer.stiffness_n_per_mm * depth_mm * depth_mm;
  }

  double EjectLimit() const {
    const double stiffness =
        std::max(At(Contact::kUpper).stiffness_n_per_mm, At(Contact::kLower).stiffness_n_per_mm);
    return stiffness > 0.0 ? kEjectForceLimitN / stiffness : kMaxHipMm;
  }

  void Step() noexcept {
    output_.proxy = StepWithFriction(felt(), Touched(), state_.p_DHip_mm, EjectLimit(),
                                     state_.proxy, state_.friction, state_.cache);
    const Proxy& proxy = state_.proxy;
    const double stiffness = Touched().stiffness_n_per_mm;
    output_.spring_D_n = proxy.on_surface()
                             ? Vec3(stiffness * (output_.proxy.p_DH_mm - state_.p_DHip_mm))
                             : Vec3::Zero();
    if (kLayered) TakeSlack(stiffness);
  }

  void TakeSlack(double stiffness_n_per_mm) noexcept {
    const Contact contact = state_.proxy.contact;
    const int touched = contact == Contact::kUpper   ? Touched().id
                        : contact == Contact::kLower ? -Touched().id
                                                     : 0;
    const double spring_n = output_.spring_D_n.norm(), before_n = state_.felt_D_n.norm();
    if (touched != state_.touched) {
      const bool changes = touched != 0 && state_.touched != 0;
      changes_layer_ = changes_layer_ || changes;
      state_.slack_mm =
          changes && spring_n > before_n ? (spring_n - before_n) / stiffness_n_per_mm : 0.0;
      state_.touched = touched;
    }
    if (!(spring_n > 0.0)) state_.slack_mm = 0.0;
    if (!(state_.slack_mm > 0.0)) return;
    state_.slack_mm = std::min(state_.slack_mm, Depth());
    output_.spring_D_n *= 1.0 - state_.slack_mm * stiffness_n_per_mm / spring_n;
  }

  double Depth() const { return (output_.proxy.p_DH_mm - state_.p_DHip_mm).norm(); }

  void StepAndPop() noexcept {
    Step();
    if (!Pops() && !LeavesBurial()) return;
    const ProxyStep first = output_.proxy;
    Step();
    output_.proxy.moves += first.moves;
    output_.proxy.tetrahedra += first.tetrahedra;
  }

  bool Pops() noexcept {
    Proxy& proxy = state_.proxy;
    const Contact bound = proxy.contact;
    const bool is_out = kLayered && bound == Contact::kLower;
    const double pop_n = is_out ? Touched().pop_out_n : Touched().pop_in_n;
    // Without contact there is no spring.
    if (!(pop_n > 0.0 && output_.spring_D_n.norm() > pop_n)) return false;
    const int way = bound == Contact::kUpper ? 1 : -1;
    if (kLayered) {
      const double gap =
          way > 0 ? Upper(passed_ + 1) - felt().isovalue : felt().lower - Lower(passed_ - 1);
      // A layer that glides waits until it is out of the other's way.
      if (gap < kLeastBand) return false;
      if (!CrossBound(felt(), bound, proxy.place, state_.cache)) return false;
    }
    Pass(way);
    if (kLayered) {
      proxy.isovalue = felt().isovalue;
      proxy.lower = felt().lower;
      proxy.contact = way > 0 ? Contact::kLower : Contact::kUpper;
    }
    return output_.popped = true;
  }

  // Without a surface to hold it, the proxy is free where the HIP is.
  bool LeavesBurial() noexcept {
    if (!state_.proxy.buried) return false;
    const int before = passed_;
    const double density = PlaceDensity(felt(), state_.proxy.place, state_.cache);
    while (passed_ < count() && density > felt().isovalue && MayPass(passed_)) Pass(1);
    while (passed_ > 0 && density < felt().lower) Pass(-1);
    if (passed_ == before) return false;
    state_.proxy.buried = !felt().Holds(density);
    return !state_.proxy.buried;
  }

  // --- Forces

  Vec3 Normal() noexcept {
    if (!settings_.force_shading) return output_.proxy.normal_D;
    const Vec3 p_LH = PlaceLatticePosition(felt(), state_.proxy.place, state_.cache);
    return ShadedNormal(felt().Facing(state_.proxy.contact), felt().lattice.ToVoxels(p_LH),
                        output_.proxy.normal_D);
  }

  // The forces against the hand, without the effects that add energy by design.
  Vec3 LimitedForce(double budget_mj) noexcept {
    const double viscosity = kLayered && passed_ > 0 ? layers_[passed_ - 1].viscosity_n_s_per_m
                                                     : settings_.viscosity_n_s_per_m;
    Vec3 force = ViscousForce(viscosity, state_.velocity_mm_per_s);
    double depth_mm = 0.0;
    if (state_.proxy.on_surface()) {
      force += ContactForce(Touched(), output_.proxy, Normal(), output_.spring_D_n,
                            state_.velocity_mm_per_s);
      depth_mm = Depth() - state_.slack_mm;
    }
    state_.spring_mj = SpringEnergy(Touched(), depth_mm);
    if (!settings_.passivity_control) {
      if (state_.passivity.started) state_.passivity = PassivityState();
      return force;
    }
    return LimitToPassive(force, Touched().stiffness_n_per_mm, depth_mm, state_.p_DHip_mm,
                          budget_mj, dt_s_, state_.device, state_.passivity);
  }

  // The fading force falls with the way that the hand takes along it, as that of the spring that
  // let go would: so it gives back no more than that had taken. Without this, it throws a light
  // hand back. The one surface is without it, so that old recordings keep their bits.
  void RelaxPop() noexcept {
    const double force_n = state_.pop_fade * state_.pop_force_D_n.norm();
    if (!(force_n > 0.0)) return;
    const Vec3 moved_mm = state_.p_DHip_mm - state_.p_DLastHip_mm;
    const double along_mm = moved_mm.dot(state_.pop_force_D_n.normalized());
    double stiffness = 0.0;
    for (int n = 0; n < count(); ++n) {
      stiffness = std::max(stiffness, layers_[n].stiffness_n_per_mm);
    }
    state_.pop_force_D_n *= std::clamp(1.0 - stiffness * along_mm / force_n, 0.0, 1.0);
  }

  // In the tick of the pop the force stays as it was. It fades from there.
  Vec3 FadingPop() noexcept {
    if (output_.popped || (kLayered && changes_layer_)) {
      state_.pop_force_D_n = state_.felt_D_n - state_.limited_D_n;
      state_.pop_fade = 1.0;
    } else if (kLayered && state_.pop_fade > 0.0) {
      RelaxPop();
    }
    const Vec3 force = state_.pop_fade * state_.pop_force_D_n;
    state_.pop_fade = std::max(0.0, state_.pop_fade - dt_s_ / kPopFadeS);
    return force;
  }

  Vec3 Magnet() noexcept {
    if (state_.proxy.on_surface() || state_.proxy.buried) return Vec3::Zero();
    if (!(settings_.magnet_force_n > 0.0)) return Vec3::Zero();
    // Sub-cells would be too many to search in a tick, and no hand tells their magnet from this
    // one.
    HapticSurface whole_cells = felt().Facing(Faced(Contact::kNone));
    whole_cells.Refine(1);
    return MagneticForce(whole_cells, settings_, state_.p_DHip_mm, *state_.magnet_cache);
  }

  // --- What others are told, and the next step

  std::uint8_t PassedBits() const {
    std::uint8_t bits = 0;
    for (int n = 0; n < passed_; ++n) bits |= layers_[n].bit();
    return bits;
  }

  void Tell() noexcept {
    state_.passed = kLayered ? PassedBits() : static_cast<std::uint8_t>(passed_);
    const bool is_lower = Faced(state_.proxy.contact) == Contact::kLower;
    output_.isovalue = is_lower ? felt().lower : felt().isovalue;
    output_.free_side = surface_.free_side;
    if (is_lower) output_.free_side = OtherSide(surface_.free_side);
    if (!kLayered) return;
    output_.layers_passed = passed_;
    if (state_.proxy.on_surface()) output_.contact_layer = Touched().id;
  }

  const HapticSurface& surface_;
  const HapticSettings& settings_;
  const double dt_s_;
  RendererState& state_;
  HapticOutput& output_;
  const Layers<kLayered> layers_;
  int passed_ = 0;                     // of layers_
  std::optional<HapticSurface> band_;  // empty: the surface itself
  bool changes_layer_ = false;         // from contact to contact
};

// The one surface is none of the layers.
void ForgetSurfaces(RendererState& state) noexcept {
  state.layered = !state.layered;
  state.passed = 0;
  state.touched = 0;
  state.slack_mm = 0.0;
}

}  // namespace

bool TrackHip(const Vec3& p_DHip_mm, double since_s, RendererState& state) noexcept {
  if (!IsPosition(p_DHip_mm)) return false;
  // If positions were rejected, the way since the last good one took longer.
  const double dt_s = since_s + state.rejected_s;
  state.rejected_s = 0.0;
  if (state.has_hip && dt_s > 0.0) {
    const Vec3 velocity = (p_DHip_mm - state.p_DHip_mm) / dt_s;
    const double share = std::min(1.0, 2.0 * std::numbers::pi * kVelocityCutoffHz * dt_s);
    state.velocity_mm_per_s += share * (velocity - state.velocity_mm_per_s);
  }
  state.p_DHip_mm = p_DHip_mm;
  return state.has_hip = true;
}

HapticOutput StepRenderer(const HapticSurface& surface, const HapticSettings& settings,
                          const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept {
  HapticOutput output;
  if (!TrackHip(p_DHip_mm, dt_s, state)) {
    output.input_rejected = true;
    state.rejected_s += dt_s;
    if (!state.has_hip) return output;
  }
  output.p_DHip_mm = state.p_DHip_mm;
  if (surface.layers != nullptr) {
    if (!state.layered) ForgetSurfaces(state);
    Update<true>(surface, settings, dt_s, state, output).Run();
  } else {
    if (state.layered) ForgetSurfaces(state);
    Update<false>(surface, settings, dt_s, state, output).Run();
  }
  state.p_DLastHip_mm = state.p_DHip_mm;
  return output;
}

VisualProxy VisualProxyOf(const HapticSurface& surface, const HapticOutput& output,
                          RendererState& state) noexcept {
  const Proxy& proxy = state.proxy;
  if (!proxy.on_surface()) return {};
  HapticSurface band = surface;
  band.isovalue = proxy.isovalue;
  band.lower = proxy.lower;
  return FindVisualProxy(band.Facing(proxy.contact), proxy.place, output.proxy.normal_D,
                         state.cache);
}

HapticOutput SuspendRenderer(const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept {
  HapticOutput output;
  output.input_rejected = !TrackHip(p_DHip_mm, dt_s, state);
  if (output.input_rejected) state.rejected_s += dt_s;
  output.p_DHip_mm = output.proxy.p_DH_mm = state.p_DLastHip_mm = state.p_DHip_mm;
  ForgetContact(state);
  return output;
}

void ForgetContact(RendererState& state) noexcept {
  state.proxy = Proxy();
  state.friction = FrictionState();
  state.passivity = PassivityState();
  state.passed = 0;
  state.touched = 0;
  state.slack_mm = state.pop_fade = state.spring_mj = 0.0;
  state.felt_D_n = state.limited_D_n = state.by_design_D_n = Vec3::Zero();
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
