// Shared by the tests of Safety: the safety stage, with an input that a test changes.
#pragma once

#include <gtest/gtest.h>

#include <limits>

#include "server/safety/safety.h"

namespace palpate {

inline constexpr double kDtS = 1e-3;
inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline const Vec3 kPush_n(0.3, -1.2, 2.0);

inline DeviceSpec Hardware() {
  DeviceSpec spec;
  spec.kind = "fake";
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

// A safety stage and its input. A test changes the input.
struct Rig {
  explicit Rig(const SafetyLimits& of_rig) : limits(of_rig), safety(of_rig) {}

  Vec3 Tick(int count = 1) {
    Vec3 force_n = Vec3::Zero();
    for (int n = 0; n < count; ++n) {
      force_n = safety.Step(input, kDtS);
      input.command = ForceCommand::kNone;
      input.missed_ticks = 0;
    }
    return force_n;
  }
  Vec3 Tell(ForceCommand command) {
    input.command = command;
    return Tick();
  }
  // Returns the force after every ramp has ended.
  Vec3 Settle() { return Tick(600); }

  SafetyLimits limits;
  Safety safety;
  SafetyInput input{.force_D_n = kPush_n};
};

inline Rig Simulated() { return Rig(SafetyLimits{}); }
inline Rig On() {
  Rig rig(LimitsFor(Hardware(), 3));
  rig.Tell(ForceCommand::kEnable);
  rig.Settle();
  return rig;
}

#define EXPECT_STATE(rig, the_state, the_reason)          \
  EXPECT_EQ((rig).safety.state(), ForceState::the_state); \
  EXPECT_EQ((rig).safety.reason(), ForceReason::the_reason)

}  // namespace palpate
