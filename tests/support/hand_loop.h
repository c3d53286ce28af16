// A hand with little damping on a rendered wall, in a closed loop. The motion between ticks is
// exact, so the energy is the true one and not the observed one.
//
// The hand is a mass with a damper, pushed with a constant force towards `aim_mm`. Its position is
// quantised. The force computed from the position is held for a tick, and may act a tick late.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "common/geometry/geometry.h"

namespace palpate::testing {

constexpr double kLoopTickS = 1e-3;
constexpr double kSensorCountMm = 0.055;
constexpr double kDeviceForceN = 3.3;

struct Hand {
  double mass_kg = 0.1;
  double damping_n_s_per_m = 0.1;
  double push_n = 1.0;
  double tremor_n = 0.0;  // amplitude of a sine added to the push
  double tremor_hz = 10.0;
  Vec3 start_mm = Vec3(0, 0, 2);
  double speed_mm_per_s = 0.0;  // towards aim_mm
  Vec3 aim_mm = Vec3(0, 0, -1e3);
};

struct Loop {
  double seconds = 10.0;
  bool is_late = true;         // a tick of delay in the device
  double slew_n = 1e9;         // greatest change of force per tick
  bool falls_at_once = false;  // the slew limit holds for a rising force only
  int flicker_ticks = 0;       // interval at which the sensor is a count off; 0: never
  int missed_ticks = 0;        // interval at which nothing is rendered; 0: never
  double count_mm = kSensorCountMm;
};

struct LoopResult {
  double given_mj = -1e9;  // greatest net energy that the hand got up to any time
  double end_mj = 0.0;     // at the end
  // Over the last 2 s:
  double force_swing_n = 0.0;  // peak to peak
  double force_n = 0.0;        // means
  double depth_mm = 0.0;
};

// Returns the force for the sensed position, the time since the last call, and the force written at
// the last call.
using RenderTick = std::function<Vec3(const Vec3& p_DHip_mm, double dt_s, const Vec3& written_n)>;
using DepthAt = std::function<double(const Vec3& p_mm)>;

class HandLoop {
 public:
  HandLoop(const Hand& hand, const Loop& loop) : hand_(hand), loop_(loop), p_mm_(hand.start_mm) {
    v_mm_per_s_ = hand.speed_mm_per_s * Aim();
  }

  LoopResult Run(const RenderTick& render, const DepthAt& true_depth_mm) {
    const int ticks = static_cast<int>(std::lround(loop_.seconds / kLoopTickS));
    const int tail = std::min(ticks, 2000);
    double low_n = 1e9, high_n = -1e9;
    for (int n = 0; n < ticks; ++n) {
      Tick(n, render);
      result_.given_mj = std::max(result_.given_mj, result_.end_mj);
      if (n < ticks - tail) continue;
      const double acting_n = acting_n_.norm();
      low_n = std::min(low_n, acting_n);
      high_n = std::max(high_n, acting_n);
      result_.force_n += acting_n / tail;
      result_.depth_mm += true_depth_mm(p_mm_) / tail;
    }
    result_.force_swing_n = high_n - low_n;
    return result_;
  }

 private:
  Vec3 Aim() const { return (hand_.aim_mm - p_mm_).normalized(); }

  Vec3 Sensed(int tick) const {
    Vec3 counts = (p_mm_ / loop_.count_mm).array().round();
    if (loop_.flicker_ticks > 0 && tick % loop_.flicker_ticks == 0) counts += Vec3(0, 0, 1);
    return counts * loop_.count_mm;
  }

  void Tick(int tick, const RenderTick& render) {
    const Vec3 before_n = written_n_;
    since_s_ += kLoopTickS;
    if (loop_.missed_ticks == 0 || tick % loop_.missed_ticks != 0) {
      Write(render(Sensed(tick), since_s_, written_n_));
      since_s_ = 0.0;
    }
    acting_n_ = loop_.is_late ? before_n : written_n_;
    const double phase = 2.0 * std::numbers::pi * hand_.tremor_hz * tick * kLoopTickS;
    const double push_n = hand_.push_n + hand_.tremor_n * std::sin(phase);
    Move(acting_n_ + push_n * Aim());
  }

  void Write(Vec3 force_n) {
    if (force_n.norm() > kDeviceForceN) force_n *= kDeviceForceN / force_n.norm();
    Vec3 change = force_n - written_n_;
    const bool is_free = loop_.falls_at_once && force_n.norm() < written_n_.norm();
    if (!is_free && change.norm() > loop_.slew_n) change *= loop_.slew_n / change.norm();
    written_n_ += change;
  }

  // m dv/dt = f - b v, solved over a tick.
  void Move(const Vec3& total_n) {
    const double mm_per_m = 1000.0;
    const double rate = hand_.damping_n_s_per_m / hand_.mass_kg;
    const double decay = std::exp(-rate * kLoopTickS);
    const Vec3 terminal = mm_per_m * total_n / hand_.damping_n_s_per_m;
    const Vec3 moved_mm =
        terminal * kLoopTickS + (v_mm_per_s_ - terminal) * (-std::expm1(-rate * kLoopTickS) / rate);
    v_mm_per_s_ = terminal + (v_mm_per_s_ - terminal) * decay;
    p_mm_ += moved_mm;
    result_.end_mj += acting_n_.dot(moved_mm);
  }

  Hand hand_;
  Loop loop_;
  Vec3 p_mm_;
  Vec3 v_mm_per_s_ = Vec3::Zero();
  Vec3 written_n_ = Vec3::Zero();
  Vec3 acting_n_ = Vec3::Zero();
  double since_s_ = 0.0;
  LoopResult result_;
};

}  // namespace palpate::testing
