// Hands of little mass and damping, which a rendered spring shakes.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/support/hand_loop.h"

namespace palpate::testing {

// What a sampled spring needs of a hand not to shake it: half of it times the tick.
inline double NeededDamping(double stiffness_n_per_mm) {
  return 1000.0 * stiffness_n_per_mm * kLoopTickS / 2.0;
}

enum class Approach { kFall, kRest, kThrow, kTremor };

inline Hand LightHand(double mass_kg, double share, double push_n, double stiffness,
                      Approach approach) {
  Hand hand{
      .mass_kg = mass_kg, .damping_n_s_per_m = share * NeededDamping(stiffness), .push_n = push_n};
  if (approach == Approach::kRest) hand.start_mm = Vec3(0, 0, 0.01);
  if (approach == Approach::kThrow) hand.speed_mm_per_s = 250.0 * push_n;
  if (approach == Approach::kTremor) {
    hand.tremor_n = 0.3 * push_n;
    hand.tremor_hz = 8.0 + 2.0 * push_n;
  }
  return hand;
}

// The extremes. NeitherDoRandomHands tests what is between them.
template <typename Visit>
void ForEachLightHand(Visit visit) {
  for (bool is_late : {false, true}) {
    for (double stiffness : {0.5, 2.0, 3.0}) {
      for (double mass_kg : {0.03, 0.2}) {
        for (double share : {0.05, 0.9}) {
          for (double push_n : {0.3, 2.0}) {
            for (Approach approach :
                 {Approach::kFall, Approach::kRest, Approach::kThrow, Approach::kTremor}) {
              SCOPED_TRACE(::testing::Message()
                           << mass_kg << " kg, " << share << " of the damping, " << push_n << " N, "
                           << stiffness << " N/mm, late " << is_late << ", approach "
                           << static_cast<int>(approach));
              visit(LightHand(mass_kg, share, push_n, stiffness, approach), stiffness, is_late);
            }
          }
        }
      }
    }
  }
}

}  // namespace palpate::testing
