// A smooth point that follows another one, and where the hand's spring must pull for the hand to be
// at that point.
//
// Frame M, mm, N, s. Real-time: as StylusScript. Same inputs, same bits out.
#pragma once

#include <algorithm>

#include "common/geometry/geometry.h"
#include "server/simulated_hand/stylus_script.h"

namespace palpate {

struct HandFollower {
  Vec3 p_mm = Vec3::Zero();
  Vec3 v_mm_s = Vec3::Zero();
  Vec3 a_mm_s2 = Vec3::Zero();

  // Two poles, both at 1 / follow_s: it lags a goal of constant speed by 2 * follow_s. Steps beyond
  // 0.82 of follow_s would swing up.
  void Follow(const Vec3& p_MGoal_mm, double follow_s, double dt_s) {
    const double step_s = std::min(dt_s, 0.5 * follow_s);
    a_mm_s2 = ((p_MGoal_mm - p_mm) / follow_s - 2.0 * v_mm_s) / follow_s;
    v_mm_s += a_mm_s2 * step_s;
    p_mm += v_mm_s * step_s;
  }

  // The spring's end for a hand that moves as this point does. `held_M_n`: what the hand feels and
  // holds against; other forces deflect it by force / kHandSpringNPerMm.
  Vec3 SpringEnd(const Vec3& held_M_n) const {
    const Vec3 pull_n = kHandDamperNsPerMm * v_mm_s + (kHandMassKg / kMmPerM) * a_mm_s2 - held_M_n;
    return p_mm + pull_n / kHandSpringNPerMm;
  }
};

}  // namespace palpate
