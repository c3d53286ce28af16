// The interface between the simulated device's hand and the scripts that lead the hand.
//
// Frame M, mm, N, s. Same inputs, same bits out.
#pragma once

#include <algorithm>
#include <cstdint>

#include "common/geometry/geometry.h"
#include "common/geometry/wrench.h"
#include "server/device/haptic_device.h"

namespace palpate {

// The hand is a mass. A spring pulls it to the script's target, and a damper slows it down. In free
// space it is a little more than critically damped. In contact with 0.5 to 1 N/mm, the damper takes
// eight times the energy that the delay of a tick feeds back.
inline constexpr double kHandMassKg = 0.1;
inline constexpr double kHandSpringNPerMm = 0.3;
inline constexpr double kHandDamperNsPerMm = 0.012;
inline constexpr double kMmPerM = 1000.0;

struct HandState {
  Vec3 p_MHip_mm = Vec3::Zero();
  Vec3 v_MHip_mm_s = Vec3::Zero();
  UnalignedQuaternion R_MS = UnalignedQuaternion::Identity();  // of the stylus
};

class StylusScript {
 public:
  struct Target {
    Vec3 p_MTarget_mm = Vec3::Zero();  // where the spring pulls the hand
    std::uint32_t buttons = 0;         // bit n: button n pressed
    Vec3 p_MLed_mm = kNowhere;         // where somebody leads the hand
    // How the hand turns the stylus; none: as it is held by itself.
    bool is_turned = false;
    UnalignedQuaternion R_MTarget = UnalignedQuaternion::Identity();
  };

  virtual ~StylusScript() = default;

  // Returns the target after `dt_s` (0 or more) more seconds. A script knows the hand and what
  // the hand feels: a force, and a torque about the tip. Of the volume it knows at most a plan that
  // was made elsewhere. Called on the servo thread, once a tick; must not lock, allocate, log,
  // throw or wait.
  virtual Target Next(const HandState& hand, const Wrench& felt_M, double dt_s) noexcept = 0;

  // Something else has led the hand in this tick; the next target is to be near it. As Next.
  virtual void ResumeAt(const HandState& /*hand*/) noexcept {}
};

// A smooth point that follows another one, and where the hand's spring must pull for the hand to be
// at that point.
//
// Frame M, mm, N, s. Real-time: as StylusScript. Same inputs, same bits out.
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
