#include "server/haptics/passivity.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// Position resolution of the device; its flicker is no motion.
constexpr double kSensorStepMm = 0.055;
// Full damping is that of a spring which acts this much early: twice the delay
// of a loop with one tick of delay and half a tick of hold.
constexpr double kLeadS = 3e-3;
// A light hand (30 g) behind a tick of delay bears no more.
constexpr double kMaxDampingNSPerMm = 4e-3;
// The device's greatest force.
constexpr double kMaxForceN = 3.3;
constexpr double kSoftMj = 0.4;
constexpr double kSafeStiffness = 0.5;
// In which a debt is forgiven while the stylus stays within a count.
constexpr double kCalmS = 1.0;
// In which a lost stiffness comes back.
constexpr double kRecoveryS = 0.3;
// Rounding of a slope must not end the window.
constexpr double kWindowSlack = 1.0 + 1e-6;

using State = PassivityState;

int Before(const State& state, int ticks) {
  return (state.newest - ticks + State::kPositionsKept) % State::kPositionsKept;
}

void Remember(const Vec3& p_DHip_mm, double dt_s, State& state) {
  const double now_s = state.started ? state.time_s[state.newest] + dt_s : 0.0;
  state.newest = (state.newest + 1) % State::kPositionsKept;
  state.p_DHip_mm[state.newest] = p_DHip_mm;
  state.time_s[state.newest] = now_s;
  state.positions = std::min(state.positions + 1, State::kPositionsKept);
}

// Whether the positions in between lie within a count of the line from `oldest`
// ticks before to the newest.
bool IsStraight(const State& state, int oldest, const Vec3& slope_mm_per_s) {
  const Vec3& p_mm = state.p_DHip_mm[state.newest];
  const double now_s = state.time_s[state.newest];
  for (int n = 1; n < oldest; ++n) {
    const int at = Before(state, n);
    const Vec3 line_mm = p_mm - slope_mm_per_s * (now_s - state.time_s[at]);
    const Vec3 off_mm = line_mm - state.p_DHip_mm[at];
    if (!(off_mm.cwiseAbs().maxCoeff() <= kSensorStepMm * kWindowSlack)) return false;
  }
  return true;
}

struct Motion {
  Vec3 velocity_mm_per_s = Vec3::Zero();
  bool is_calm = false;  // within a count for as long as positions are kept
};

Motion Observed(const State& state) {
  Motion motion;
  for (int n = 1; n < state.positions; ++n) {
    const int at = Before(state, n);
    const Vec3 moved_mm = state.p_DHip_mm[state.newest] - state.p_DHip_mm[at];
    const Vec3 slope = moved_mm / (state.time_s[state.newest] - state.time_s[at]);
    if (!IsStraight(state, n, slope)) break;
    motion.velocity_mm_per_s = slope;
    motion.is_calm = n + 1 == State::kPositionsKept &&
                     moved_mm.cwiseAbs().maxCoeff() <= kSensorStepMm * kWindowSlack;
  }
  return motion;
}

// Energy that the hand surely gave while it moved by `moved_mm`.
double LeastAbsorbed(const State& state, const Vec3& moved_mm) {
  return -(moved_mm.transpose() * state.written_D_n).maxCoeff();
}

// Energy that a spring gives back on the way out, its force cut off at the limit.
double Stored(double stiffness_n_per_mm, double depth_mm) {
  const double force_n = std::min(stiffness_n_per_mm * depth_mm, kMaxForceN);
  return force_n > 0.0 ? force_n * (depth_mm - force_n / (2.0 * stiffness_n_per_mm)) : 0.0;
}

// The share of the stiffness with which no more than `energy_mj` is stored.
double Bearable(double stiffness_n_per_mm, double depth_mm, double energy_mj) {
  if (Stored(stiffness_n_per_mm, depth_mm) <= energy_mj) return 1.0;
  if (!(energy_mj > 0.0)) return 0.0;
  const double cut_off_mj = kMaxForceN * depth_mm - energy_mj;
  const double stiffness = energy_mj <= cut_off_mj ? 2.0 * energy_mj / (depth_mm * depth_mm)
                                                   : kMaxForceN * kMaxForceN / (2.0 * cut_off_mj);
  return std::min(1.0, stiffness / stiffness_n_per_mm);
}

void Observe(const Vec3& p_DHip_mm, double budget_mj, double dt_s, State& state) {
  if (state.started) {
    state.tank_mj += LeastAbsorbed(state, p_DHip_mm - state.p_DHip_mm[state.newest]) + budget_mj;
  }
  Remember(p_DHip_mm, dt_s, state);
  state.started = true;
}

// The force is scaled as its spring is, and cut off at the limit.
double Scaled(double force_n, double scale) { return std::min(force_n * scale, kMaxForceN); }

Vec3 Limited(const Vec3& force_D_n, double stiffness_n_per_mm, double depth_mm,
             const Vec3& p_DHip_mm, double budget_mj, double dt_s, State& state) {
  Observe(p_DHip_mm, budget_mj, dt_s, state);
  const Motion motion = Observed(state);
  const double stored_mj = Stored(stiffness_n_per_mm, depth_mm);
  const bool calm =
      motion.is_calm && state.scale * stiffness_n_per_mm <= kSafeStiffness * kWindowSlack;
  if (calm && depth_mm > 0.0) {
    const double wanted = Stored(state.scale * stiffness_n_per_mm, depth_mm) - kFullDampingMj;
    state.tank_mj += std::max(0.0, wanted - state.tank_mj) * std::min(1.0, dt_s / kCalmS);
  }
  state.tank_mj = std::min(state.tank_mj + kForgivenMjPerS * dt_s, stored_mj);
  const double lacking_mj = Stored(state.scale * stiffness_n_per_mm, depth_mm) - state.tank_mj;
  state.damping = std::clamp(lacking_mj / kFullDampingMj, 0.0, 1.0);
  const double fade_s = depth_mm > 0.0 ? 1e30 : kRecoveryS;
  state.distrust =
      std::max(state.distrust * (1.0 - std::min(1.0, dt_s / fade_s)),
               std::clamp((lacking_mj - kFullDampingMj) / (kSoftMj - kFullDampingMj), 0.0, 1.0));
  const double safe = std::min(1.0, kSafeStiffness / stiffness_n_per_mm);
  state.scale = std::min(1.0 - state.distrust * (1.0 - safe),
                         Bearable(stiffness_n_per_mm, depth_mm, state.tank_mj + kCreditMj));
  const double force_n = force_D_n.norm();
  if (!(force_n > 0.0)) return force_D_n;
  const Vec3 direction = force_D_n / force_n;
  if (!(stored_mj > 0.0)) return direction * Scaled(force_n, 1.0);
  const double full = std::min(stiffness_n_per_mm * kLeadS, kMaxDampingNSPerMm);
  const double damper_n = -state.damping * full * motion.velocity_mm_per_s.dot(direction);
  return direction * std::clamp(Scaled(force_n, state.scale) + damper_n, 0.0, kMaxForceN);
}

}  // namespace

Vec3 LimitToPassive(const Vec3& force_D_n, double stiffness_n_per_mm, double depth_mm,
                    const Vec3& p_DHip_mm, double budget_mj, double dt_s, State& state) noexcept {
  const bool usable = force_D_n.allFinite() && p_DHip_mm.allFinite() && dt_s > 0.0 &&
                      std::isfinite(stiffness_n_per_mm + depth_mm + budget_mj + dt_s);
  Vec3 limited_D_n = Vec3::Zero();
  if (usable) {
    limited_D_n =
        Limited(force_D_n, stiffness_n_per_mm, depth_mm, p_DHip_mm, budget_mj, dt_s, state);
  }
  // Finite numbers may overflow.
  if (!usable || !limited_D_n.allFinite() || !std::isfinite(state.tank_mj)) {
    state = {};
    return Vec3::Zero();
  }
  for (int n = State::kForcesCounted - 1; n > 0; --n) {
    state.written_D_n.col(n) = state.written_D_n.col(n - 1);
  }
  state.written_D_n.col(0) = limited_D_n;
  return limited_D_n;
}

}  // namespace palpate
