#include "server/haptics/tool/tool_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/haptics/effects.h"
#include "server/haptics/isovalue_glide.h"
#include "server/haptics/tool/least_move.h"

namespace palpate {
namespace {

// More than rounding of a device that counts angles.
constexpr double kUnitTolerance = 1e-3;
// Of the orientation, where devices do not tell: about that of a Touch's gimbal.
constexpr double kResolutionRad = 5e-4;

bool IsOrientation(const Eigen::Quaterniond& q) {
  return q.coeffs().allFinite() && std::abs(q.squaredNorm() - 1.0) < kUnitTolerance;
}

Vec6 Vector(const Wrench& wrench) {
  Vec6 vector;
  vector << wrench.force_n, wrench.torque_n_mm;
  return vector;
}

class ToolUpdate {
 public:
  ToolUpdate(const FeltTool& felt, const HapticSettings& settings, const ToolPose& stylus,
             double dt_s, int work, RendererState& state, ToolMemory& memory, ToolOutput& output)
      : felt_(felt),
        settings_(settings),
        stylus_(stylus),
        dt_s_(dt_s),
        work_(work),
        rho_mm_(felt.tool.rotation_length_mm),
        state_(state),
        memory_(memory),
        output_(output),
        surface_(felt.surface) {}

  void Run() noexcept {
    ChooseSurface();
    const bool was_placed = memory_.state.placed;
    const double budget_mj = Settle();
    // An ejection is the surface's work to its end.
    const bool is_pushed = settled_.capped && settled_.mode == ProxyMode::kEjecting;
    output_.tool = is_pushed ? settled_ : Step(stylus_, work_ - settled_.work);
    if (is_pushed) settled_ = {};
    const ToolMove pull = MoveBetween(stylus_, output_.tool.pose);
    const double depth_mm = Length(pull);
    Remember(depth_mm, was_placed);
    const Wrench wrench_D = Passive(WrenchOf(pull), pull, budget_mj);
    state_.limited_D_n = wrench_D.force_n;
    Tell(pull, wrench_D);
  }

 private:
  // In the metric of the coupling.
  double Length(const ToolMove& move) const {
    return std::sqrt(move.way_mm.squaredNorm() + rho_mm_ * rho_mm_ * move.turn_rad.squaredNorm());
  }
  double SpringEnergy(double depth_mm) const {
    return 0.5 * settings_.stiffness_n_per_mm * depth_mm * depth_mm;
  }
  bool has_torque() const { return state_.device.max_torque_n_mm > 0.0; }

  ToolStep Step(const ToolPose& stylus, int work) noexcept {
    ToolSurfaces surfaces;
    for (int n = 0; n < felt_.tool.radius_count; ++n) surfaces.surface[n] = &surface_[n];
    surfaces.cache = felt_.cache;
    const double stiffness = settings_.stiffness_n_per_mm;
    const double eject_limit_mm =
        stiffness > 0.0 ? kEjectForceLimitN / stiffness : std::numeric_limits<double>::infinity();
    return StepTool(felt_.tool, surfaces, stylus, eject_limit_mm, work, memory_.state);
  }

  // --- The surface

  // While the tool touches, the isovalue glides, and another refinement waits.
  void ChooseSurface() noexcept {
    const ToolState& tool = memory_.state;
    const bool holds = tool.placed && !tool.buried && (memory_.touches || tool.ejecting_steps > 0);
    const ToolSurfacesFelt& last = memory_.felt;
    for (int n = 0; n < felt_.tool.radius_count; ++n) {
      HapticSurface& surface = surface_[n];
      if (holds && surface.lattice.refinement() != last.refinement) surface.Refine(last.refinement);
      const bool glides = holds && state_.glides && surface.free_side == last.free_side &&
                          surface.volume->loaded_revision() == memory_.state.loaded_revision;
      if (!glides) continue;
      const double rate_per_s =
          std::clamp(kGlideSpeedMmPerS * memory_.slope_per_mm, kMinGlidePerS, kMaxGlidePerS);
      const double most = rate_per_s * std::min(dt_s_, kLongestGlideTickS);
      surface.isovalue = last.isovalue + std::clamp(surface.isovalue - last.isovalue, -most, most);
    }
  }

  // Where the surface has moved, the tool first comes to rest with the stylus at its old place: for
  // some steps, if the work is not enough for one. Returns the energy that the spring gained by
  // that, or by its stiffness.
  double Settle() noexcept {
    const HapticSurface& first = surface_[0];
    const ToolSurfacesFelt now{
        first.geometry_revision, first.volume->revision(), first.lattice.refinement(),
        first.free_side,         first.isovalue,           settings_.stiffness_n_per_mm};
    const bool settles = memory_.is_settling;
    const bool same = !memory_.state.placed || (now == memory_.felt && !settles);
    memory_.felt = now;
    if (same) return 0.0;
    const ToolPose last{state_.p_DLastHip_mm, memory_.R_DS};
    settled_ = Step(last, work_ / 2);
    memory_.is_settling = settled_.capped;
    const double gained_mj =
        SpringEnergy(Length(MoveBetween(last, settled_.pose))) - memory_.spring_mj;
    // On the way to rest it may first gain more than it keeps.
    return settles || settled_.capped ? gained_mj : std::max(0.0, gained_mj);
  }

  void Remember(double depth_mm, bool was_placed) noexcept {
    if (was_placed) {
      turned_rad_ = MoveBetween({Vec3::Zero(), memory_.R_DS}, stylus_).turn_rad;
      memory_.turned_mm += rho_mm_ * turned_rad_;
    }
    memory_.R_DS = stylus_.R_DS;
    memory_.spring_mj = SpringEnergy(depth_mm);
    memory_.touches = output_.tool.touching != 0;
    memory_.slope_per_mm = output_.tool.slope_per_mm;
  }

  // --- The wrench

  Wrench WrenchOf(const ToolMove& pull) const noexcept {
    const double stiffness = settings_.stiffness_n_per_mm;
    const Vec3 spring_D_n = stiffness * pull.way_mm;
    Vec3 force_n = spring_D_n;
    const double length_mm = pull.way_mm.norm();
    if (memory_.touches && length_mm > 0.0) {
      const HapticLayer layer{.stiffness_n_per_mm = stiffness,
                              .damping_n_s_per_m = settings_.damping_n_s_per_m};
      ProxyStep contact;
      contact.normal_D = pull.way_mm / length_mm;
      force_n =
          ContactForce(layer, contact, contact.normal_D, spring_D_n, state_.velocity_mm_per_s);
    }
    force_n += ViscousForce(settings_.viscosity_n_s_per_m, state_.velocity_mm_per_s);
    return {force_n, stiffness * rho_mm_ * rho_mm_ * pull.turn_rad};
  }

  Wrench Passive(Wrench wrench, const ToolMove& pull, double budget_mj) noexcept {
    if (!has_torque()) wrench.torque_n_mm.setZero();
    const double held_mm = Length(pull);
    const double depth_mm = has_torque() ? held_mm : pull.way_mm.norm();
    double scale = 1.0;  // of the stiffness, by the control
    if (settings_.passivity_control) {
      wrench = has_torque()
                   ? Limited(wrench, depth_mm, budget_mj)
                   : Wrench{.force_n = Limited(wrench.force_n, depth_mm, held_mm, budget_mj)};
      scale = has_torque() ? memory_.passivity.scale : state_.passivity.scale;
    } else if (state_.passivity.started || memory_.passivity.started) {
      state_.passivity = {};
      memory_.passivity = {};
    }
    Vec6 moved;
    moved << stylus_.p_DS_mm - state_.p_DLastHip_mm, turned_rad_;
    const double share = memory_.tank.ShareOf(Vector(wrench), scale * SpringEnergy(depth_mm),
                                              scale * SpringEnergy(held_mm), moved, budget_mj);
    wrench = {share * wrench.force_n, share * wrench.torque_n_mm};
    TellWrittenWrench(wrench, rho_mm_, state_, memory_);
    return wrench;
  }

  Wrench Limited(const Wrench& wrench, double depth_mm, double budget_mj) noexcept {
    PassivityDevice device = state_.device;
    device.resolution_mm = std::max(device.resolution_mm, rho_mm_ * kResolutionRad);
    const double turning_n = device.max_torque_n_mm / rho_mm_;
    device.max_force_n = std::sqrt(device.max_force_n * device.max_force_n + turning_n * turning_n);
    Vec6 force, place;
    force << wrench.force_n, wrench.torque_n_mm / rho_mm_;
    place << stylus_.p_DS_mm, memory_.turned_mm;
    const Vec6 passive = LimitToPassive(force, settings_.stiffness_n_per_mm, depth_mm, place,
                                        budget_mj, dt_s_, device, memory_.passivity);
    return {passive.head<3>(), rho_mm_ * passive.tail<3>()};
  }

  Vec3 Limited(const Vec3& force_n, double depth_mm, double held_mm, double budget_mj) noexcept {
    return LimitToPassive(force_n, settings_.stiffness_n_per_mm, depth_mm, stylus_.p_DS_mm,
                          budget_mj, dt_s_, state_.device, state_.passivity, held_mm);
  }

  void Tell(const ToolMove& pull, const Wrench& wrench_D) noexcept {
    ToolStep& step = output_.tool;
    step.work += settled_.work;
    step.rounds += settled_.rounds;
    step.capped = step.capped || settled_.capped;
    output_.torque_D_n_mm = wrench_D.torque_n_mm;
    HapticOutput& haptic = output_.haptic;
    haptic.force_D_n = wrench_D.force_n;
    haptic.spring_D_n = settings_.stiffness_n_per_mm * pull.way_mm;
    haptic.isovalue = surface_[0].isovalue;
    haptic.free_side = surface_[0].free_side;
    haptic.proxy.p_DH_mm = step.pose.p_DS_mm;
    haptic.proxy.mode = step.mode;
    haptic.proxy.moves = step.rounds;
    haptic.proxy.tetrahedra = step.work;
    haptic.proxy.capped = step.capped;
    haptic.proxy.density = DensityOfTheFirstBall();
    const double length_mm = pull.way_mm.norm();
    if (memory_.touches && length_mm > 0.0) haptic.proxy.normal_D = pull.way_mm / length_mm;
  }

  double DensityOfTheFirstBall() noexcept {
    const ToolBall& ball = felt_.tool.ball[0];
    const ToolPose& pose = output_.tool.pose;
    const HapticSurface& surface = surface_[ball.radius];
    double density = 0.0;
    PlaceAt(surface, surface.X_LD.Apply(pose.p_DS_mm + pose.R_DS * ball.p_SBall_mm), state_.cache,
            density);
    return surface.sign() * density;
  }

  const FeltTool& felt_;
  const HapticSettings& settings_;
  const ToolPose& stylus_;
  const double dt_s_;
  const int work_;
  const double rho_mm_;
  RendererState& state_;
  ToolMemory& memory_;
  ToolOutput& output_;
  std::array<HapticSurface, kMostToolRadii> surface_;  // of this step
  ToolStep settled_;
  Vec3 turned_rad_ = Vec3::Zero();  // the stylus's last turn
};

}  // namespace

ToolOutput StepWithTool(const FeltTool& felt, const HapticSettings& settings, const Vec3& p_DHip_mm,
                        const Eigen::Quaterniond& R_DS, double dt_s, int work, RendererState& state,
                        ToolMemory& memory) noexcept {
  ToolOutput output;
  const bool is_rejected = !IsOrientation(R_DS) || !TrackHip(p_DHip_mm, dt_s, state);
  output.haptic.input_rejected = is_rejected;
  if (is_rejected) {
    state.rejected_s += dt_s;
    if (!state.has_hip || !memory.state.placed) return output;
  }
  if (!memory.state.placed) {
    ForgetContact(state);
    state.layered = false;
  }
  const Eigen::Quaterniond turned =
      is_rejected ? Eigen::Quaterniond(memory.R_DS) : R_DS.normalized();
  output.haptic.p_DHip_mm = state.p_DHip_mm;
  ToolUpdate(felt, settings, {state.p_DHip_mm, turned}, dt_s, work, state, memory, output).Run();
  state.p_DLastHip_mm = state.p_DHip_mm;
  return output;
}

void TellWrittenWrench(const Wrench& written_D, double rotation_length_mm, RendererState& state,
                       ToolMemory& memory) noexcept {
  memory.tank.written_D = Vector(written_D);
  if (state.passivity.started) state.passivity.written_D_n.col(0) = written_D.force_n;
  if (!memory.passivity.started) return;
  memory.passivity.written_D_n.col(0) << written_D.force_n,
      written_D.torque_n_mm / rotation_length_mm;
}

}  // namespace palpate
