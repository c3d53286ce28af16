// What the simulated device's hand wants: the seam between the hand and the
// scripts that lead it.
//
// Frame D, mm, N, s. Same inputs, same bits out.
#pragma once

#include <cstdint>

#include "common/geometry/geometry.h"

namespace palpate {

// The hand is a mass that a spring pulls to the script's target and a damper
// slows down. It is a little more than critically damped in free space; in
// contact with 0.5 to 1 N/mm the damper outweighs what the delay of a tick feeds
// back by a factor of eight.
inline constexpr double kHandMassKg = 0.1;
inline constexpr double kHandSpringNPerMm = 0.3;
inline constexpr double kHandDamperNsPerMm = 0.012;

struct HandState {
  Vec3 p_DHip_mm = Vec3::Zero();
  Vec3 v_DHip_mm_s = Vec3::Zero();
};

class StylusScript {
 public:
  struct Target {
    Vec3 p_DTarget_mm = Vec3::Zero();  // where the spring pulls the hand
    std::uint32_t buttons = 0;         // bit n: button n pressed
  };

  virtual ~StylusScript() = default;

  // The target after `dt_s` (0 or more) more seconds. A script knows the hand and
  // the force it feels, and nothing of the volume. Servo thread, once a tick; never
  // locks, allocates, logs, throws or waits.
  virtual Target Next(const HandState& hand, const Vec3& felt_force_D_n, double dt_s) noexcept = 0;
};

}  // namespace palpate
