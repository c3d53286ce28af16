#include "server/haptics/passivity.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

template <int kDimensions>
using State = PassivityStateOf<kDimensions>;
template <int kDimensions>
using Vector = typename PassivityStateOf<kDimensions>::Vector;

// The full damper equals a spring that acts this much earlier: twice the device's delay of a tick,
// and half a tick of hold.
constexpr double kLeadTicks = 3.0;
// A stronger damper would itself vibrate under a light hand, because the damper acts late, too.
constexpr double kMaxDampingNSPerMm = 2.5e-3;
// Out of contact, the stiffness returns in this time.
constexpr double kRecoveryS = 0.3;
// A stylus that stays within a count for kRestS rests. Missing energy is then forgiven in
// kForgivingS, before a sensor that flickers at every tick empties the tank.
constexpr double kRestS = 0.01;
constexpr double kForgivingS = 0.05;
// Tolerates rounding where a value meets its limit exactly.
constexpr double kSlack = 1.0 + 1e-6;

template <int kDimensions>
int Before(const State<kDimensions>& state, int ticks) {
  return (state.newest - ticks + State<kDimensions>::kPositionsKept) %
         State<kDimensions>::kPositionsKept;
}

template <int kDimensions>
bool WithinACount(const Vector<kDimensions>& d_mm, double count_mm) {
  return d_mm.cwiseAbs().maxCoeff() <= count_mm * kSlack;
}

template <int kDimensions>
void Remember(const Vector<kDimensions>& p_DHip_mm, double dt_s, double count_mm,
              State<kDimensions>& state) {
  const double now_s = state.started ? state.time_s[state.newest] + dt_s : 0.0;
  state.newest = (state.newest + 1) % State<kDimensions>::kPositionsKept;
  state.p_DHip_mm[state.newest] = p_DHip_mm;
  state.time_s[state.newest] = now_s;
  state.positions = std::min(state.positions + 1, State<kDimensions>::kPositionsKept);
  const bool rests =
      state.started && WithinACount<kDimensions>(p_DHip_mm - state.rest_mm, count_mm);
  state.rested_s = rests ? state.rested_s + dt_s : 0.0;
  if (!rests) state.rest_mm = p_DHip_mm;
  state.started = true;
}

// True if the last `ticks` positions lie on a line of this slope, within a count.
template <int kDimensions>
bool IsStraight(const State<kDimensions>& state, int ticks,
                const Vector<kDimensions>& slope_mm_per_s, double count_mm) {
  for (int n = 1; n < ticks; ++n) {
    const int at = Before(state, n);
    const double ago_s = state.time_s[state.newest] - state.time_s[at];
    const Vector<kDimensions> moved_mm = state.p_DHip_mm[state.newest] - state.p_DHip_mm[at];
    if (!WithinACount<kDimensions>(moved_mm - slope_mm_per_s * ago_s, count_mm)) return false;
  }
  return true;
}

template <int kDimensions>
Vector<kDimensions> Velocity(const State<kDimensions>& state, double count_mm) {
  Vector<kDimensions> velocity_mm_per_s = Vector<kDimensions>::Zero();
  for (int n = 1; n < state.positions; ++n) {
    const int at = Before(state, n);
    const Vector<kDimensions> moved_mm = state.p_DHip_mm[state.newest] - state.p_DHip_mm[at];
    const Vector<kDimensions> slope = moved_mm / (state.time_s[state.newest] - state.time_s[at]);
    if (!IsStraight(state, n, slope, count_mm)) break;
    velocity_mm_per_s = slope;
  }
  return velocity_mm_per_s;
}

// The least energy that the hand can have given while it moved by `moved_mm`.
template <int kDimensions>
double LeastAbsorbed(const State<kDimensions>& state, const Vector<kDimensions>& moved_mm) {
  return -(moved_mm.transpose() * state.written_D_n).maxCoeff();
}

// The energy that a spring gives back on the way out, with its force limited to max_force_n.
double Stored(double stiffness_n_per_mm, double depth_mm, double max_force_n) {
  const double force_n = std::min(stiffness_n_per_mm * depth_mm, max_force_n);
  return force_n > 0.0 ? force_n * (depth_mm - force_n / (2.0 * stiffness_n_per_mm)) : 0.0;
}

// The share of the stiffness that stores no more than `energy_mj`.
double Bearable(double stiffness_n_per_mm, double depth_mm, double energy_mj, double max_force_n) {
  if (Stored(stiffness_n_per_mm, depth_mm, max_force_n) <= energy_mj) return 1.0;
  if (!(energy_mj > 0.0)) return 0.0;
  // Above half the work of the greatest force, the force limit takes effect.
  const double cut_off_mj = max_force_n * depth_mm - energy_mj;
  const double stiffness = energy_mj <= cut_off_mj ? 2.0 * energy_mj / (depth_mm * depth_mm)
                                                   : max_force_n * max_force_n / (2.0 * cut_off_mj);
  return std::min(1.0, stiffness / stiffness_n_per_mm);
}

// Sets the stiffness that the tank allows, and the damping that fills the tank.
template <int kDimensions>
void Control(double stiffness_n_per_mm, double depth_mm, double held_mm, double dt_s,
             double max_force_n, State<kDimensions>& state) {
  const double spring_mj = Stored(state.scale * stiffness_n_per_mm, depth_mm, max_force_n);
  double forgiven_mj = kForgivenMjPerS * dt_s;
  if (depth_mm > 0.0) {
    // Forgives not all, so that some damping remains.
    const double missing_mj = std::max(0.0, spring_mj - kFullDampingMj - state.tank_mj);
    const bool is_safe = state.scale * stiffness_n_per_mm <= kSafeNPerMm * kSlack;
    if (is_safe && state.rested_s > kRestS) forgiven_mj += missing_mj * dt_s / kForgivingS;
    forgiven_mj = std::min(forgiven_mj, missing_mj);
  }
  state.tank_mj += forgiven_mj;
  state.tank_mj =
      std::min(state.tank_mj, Stored(stiffness_n_per_mm, std::max(depth_mm, held_mm), max_force_n));

  const double lacking_mj = spring_mj - state.tank_mj;
  state.damping = std::clamp(lacking_mj / kFullDampingMj, 0.0, 1.0);
  if (!(depth_mm > 0.0)) state.distrust *= 1.0 - std::min(1.0, dt_s / kRecoveryS);
  const double soft = (lacking_mj - kFullDampingMj) / (kSoftMj - kFullDampingMj);
  state.distrust = std::max(state.distrust, std::clamp(soft, 0.0, 1.0));
  const double safe = std::min(1.0, kSafeNPerMm / stiffness_n_per_mm);
  state.scale =
      std::min(1.0 - state.distrust * (1.0 - safe),
               Bearable(stiffness_n_per_mm, depth_mm, state.tank_mj + kCreditMj, max_force_n));
}

template <int kDimensions>
Vector<kDimensions> Shortened(const Vector<kDimensions>& v, double length) {
  const double norm = v.norm();
  return norm > length ? Vector<kDimensions>(v * (length / norm)) : v;
}

template <int kDimensions>
Vector<kDimensions> Limited(const Vector<kDimensions>& force_D_n, double stiffness_n_per_mm,
                            double depth_mm, const PassivityDevice& device,
                            const State<kDimensions>& state) {
  const double max_force_n = device.max_force_n;
  const double force_n = force_D_n.norm();
  if (!(force_n > 0.0)) return Vector<kDimensions>::Zero();
  const Vector<kDimensions> direction = force_D_n / force_n;
  if (!(stiffness_n_per_mm * depth_mm > 0.0)) return direction * std::min(force_n, max_force_n);
  const double full =
      std::min(stiffness_n_per_mm * (kLeadTicks * device.tick_s), kMaxDampingNSPerMm);
  const Vector<kDimensions> drag_n = -state.damping * full * Velocity(state, device.resolution_mm);
  // The spring is scaled first and limited afterwards.
  const double spring_n = std::min(state.scale * force_n, max_force_n);
  const double along_n = std::clamp(spring_n + drag_n.dot(direction), 0.0, max_force_n);
  // Across, at most as much as along, so that the force stays continuous at contact.
  const Vector<kDimensions> across = drag_n - drag_n.dot(direction) * direction;
  return Shortened<kDimensions>(along_n * direction + Shortened<kDimensions>(across, along_n),
                                max_force_n);
}

}  // namespace

bool IsDevice(const PassivityDevice& device) {
  const double numbers[] = {device.resolution_mm, device.max_force_n, device.tick_s};
  return std::ranges::all_of(numbers, [](double n) { return std::isfinite(n) && n > 0.0; }) &&
         std::isfinite(device.max_torque_n_mm) && device.max_torque_n_mm >= 0.0;
}

template <int kDimensions>
Vector<kDimensions> LimitToPassive(const Vector<kDimensions>& force_D_n, double stiffness_n_per_mm,
                                   double depth_mm, const Vector<kDimensions>& p_DHip_mm,
                                   double budget_mj, double dt_s, const PassivityDevice& device,
                                   State<kDimensions>& state, double held_mm) noexcept {
  Vector<kDimensions> limited_D_n = Vector<kDimensions>::Zero();
  if (force_D_n.allFinite() && p_DHip_mm.allFinite() && dt_s > 0.0 &&
      std::isfinite(stiffness_n_per_mm + depth_mm + held_mm + budget_mj + dt_s)) {
    if (state.started) {
      const Vector<kDimensions> moved_mm = p_DHip_mm - state.p_DHip_mm[state.newest];
      state.tank_mj += LeastAbsorbed(state, moved_mm) + budget_mj;
    }
    Remember(p_DHip_mm, dt_s, device.resolution_mm, state);
    Control(stiffness_n_per_mm, depth_mm, held_mm, dt_s, device.max_force_n, state);
    limited_D_n = Limited(force_D_n, stiffness_n_per_mm, depth_mm, device, state);
  } else {
    state = {};
  }
  // Finite numbers may overflow in the sums.
  if (!limited_D_n.allFinite() || !std::isfinite(state.tank_mj + state.scale)) {
    state = {};
    limited_D_n.setZero();
  }
  for (int n = State<kDimensions>::kForcesCounted - 1; n > 0; --n) {
    state.written_D_n.col(n) = state.written_D_n.col(n - 1);
  }
  state.written_D_n.col(0) = limited_D_n;
  return limited_D_n;
}

template Vec3 LimitToPassive<3>(const Vec3&, double, double, const Vec3&, double, double,
                                const PassivityDevice&, PassivityStateOf<3>&, double) noexcept;
template Vector<6> LimitToPassive<6>(const Vector<6>&, double, double, const Vector<6>&, double,
                                     double, const PassivityDevice&, PassivityStateOf<6>&,
                                     double) noexcept;

}  // namespace palpate
