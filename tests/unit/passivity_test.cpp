// Passivity control on a plane: hands that a plain spring shakes, hands that it
// does not, and input of any kind.
#include "server/haptics/passivity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/support/hand_loop.h"
#include "tests/support/light_hands.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using testing::Approach;
using testing::ForEachLightHand;
using testing::Hand;
using testing::HandLoop;
using testing::kLoopTickS;
using testing::kSensorCountMm;
using testing::LightHand;
using testing::Loop;
using testing::LoopResult;

constexpr double kMmPerM = 1000.0;

struct Wall {
  double stiffness_n_per_mm = 1.0;
  bool is_controlled = true;
  double damping_n_s_per_m = 0.0;
  double viscosity_n_s_per_m = 0.0;
  bool tells_written = true;  // what a slew limit left of the force is told
  PassivityDevice device{};
};

// Solid below z = 0.
double Depth(const Vec3& p_mm) { return std::max(0.0, -p_mm.z()); }

// How much the control changes of the force, in contact, after the first second.
struct Change {
  long ticks = 0;
  long changed = 0;  // by more than 1 % and more than the step of a sensor count
  double share = 0.0;
};

class PlaneRenderer {
 public:
  PlaneRenderer(const Wall& wall, Change& change) : wall_(wall), change_(change) {}

  Vec3 Render(const Vec3& p_DHip_mm, double dt_s, const Vec3& written_n) {
    const Vec3 plain_n = PlainForce(p_DHip_mm, dt_s);
    if (!wall_.is_controlled) return plain_n;
    if (wall_.tells_written) state_.written_D_n.col(0) = written_n;
    const Vec3 force_n = LimitToPassive(plain_n, wall_.stiffness_n_per_mm, Depth(p_DHip_mm),
                                        p_DHip_mm, 0.0, dt_s, wall_.device, state_);
    time_s_ += dt_s;
    if (time_s_ > 1.0 && plain_n.norm() > 0.0) Note(plain_n, force_n);
    return force_n;
  }

 private:
  // As the renderer computes it: a low-passed velocity, a damper within the spring.
  Vec3 PlainForce(const Vec3& p_DHip_mm, double dt_s) {
    const double share = std::min(1.0, 2.0 * std::numbers::pi * 40.0 * dt_s);
    if (has_last_) v_mm_per_s_ += share * ((p_DHip_mm - last_mm_) / dt_s - v_mm_per_s_);
    last_mm_ = p_DHip_mm;
    has_last_ = true;
    const double spring_n = wall_.stiffness_n_per_mm * Depth(p_DHip_mm);
    if (!(spring_n > 0.0)) return Vec3::Zero();
    const double damper_n = -wall_.damping_n_s_per_m / kMmPerM * v_mm_per_s_.z();
    return Vec3(0, 0, spring_n + std::clamp(damper_n, -spring_n, spring_n)) -
           wall_.viscosity_n_s_per_m / kMmPerM * v_mm_per_s_;
  }

  void Note(const Vec3& plain_n, const Vec3& force_n) {
    const double wanted_n = std::min(plain_n.norm(), testing::kDeviceForceN);
    const double off_n = (force_n - plain_n * (wanted_n / plain_n.norm())).norm();
    const double step_n = wall_.stiffness_n_per_mm * kSensorCountMm;
    ++change_.ticks;
    change_.changed += off_n > std::max(0.01 * wanted_n, step_n);
    change_.share += off_n / wanted_n;
  }

  Wall wall_;
  PassivityState state_;
  Change& change_;
  Vec3 last_mm_ = Vec3::Zero();
  Vec3 v_mm_per_s_ = Vec3::Zero();
  bool has_last_ = false;
  double time_s_ = 0.0;
};

LoopResult Touch(const Hand& hand, const Wall& wall, const Loop& loop, Change& change) {
  PlaneRenderer renderer(wall, change);
  return HandLoop(hand, loop)
      .Run([&](const Vec3& p, double dt_s,
               const Vec3& written) { return renderer.Render(p, dt_s, written); },
           Depth);
}
LoopResult Touch(const Hand& hand, const Wall& wall, const Loop& loop) {
  Change unused;
  return Touch(hand, wall, loop, unused);
}

// The control of the tests below: without passivity control the hand is shaken.
TEST(Passivity, WithoutItAHandOfLittleDampingGainsEnergy) {
  double least_mj = 1e9, least_swing_n = 1e9;
  ForEachLightHand([&](const Hand& hand, double stiffness, bool is_late) {
    if (stiffness != 2.0) return;
    const Wall wall{.stiffness_n_per_mm = stiffness, .is_controlled = false};
    const LoopResult result = Touch(hand, wall, {.is_late = is_late});
    least_mj = std::min(least_mj, result.given_mj);
    least_swing_n = std::min(least_swing_n, result.force_swing_n);
  });
  EXPECT_GT(least_mj, 1.5);
  EXPECT_GT(least_swing_n, 0.5);
}

TEST(Passivity, NoHandGainsEnergyOrIsShakenAndTheWallHolds) {
  ForEachLightHand([&](const Hand& hand, double stiffness, bool is_late) {
    const Wall wall{.stiffness_n_per_mm = stiffness};
    const Loop loop{.is_late = is_late};
    const LoopResult result = Touch(hand, wall, loop);
    EXPECT_LE(result.given_mj, 0.15);
    const Wall damped{
        .stiffness_n_per_mm = stiffness, .damping_n_s_per_m = 5.0, .viscosity_n_s_per_m = 2.0};
    EXPECT_LE(Touch(hand, damped, loop).given_mj, 1.0);
    if (hand.tremor_n > 0.0) return;
    // Twice the amplitude.
    EXPECT_LE(result.force_swing_n, 0.15);
    EXPECT_NEAR(result.force_n, hand.push_n, 0.05);
    EXPECT_GT(result.force_n / result.depth_mm, 0.9 * kSafeNPerMm);
  });
}

TEST(Passivity, NeitherDoRandomHands) {
  const int hands = test::Scaled(300);
  std::mt19937_64 random(3);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int shaken = 0;
  for (int n = 0; n < hands; ++n) {
    SCOPED_TRACE(n);
    const Wall wall{.stiffness_n_per_mm = between(0.3, 3.0)};
    const Loop loop{.seconds = 10.0,
                    .is_late = random() % 2 == 0,
                    .missed_ticks = random() % 4 == 0 ? static_cast<int>(between(20, 200)) : 0};
    Hand hand = LightHand(between(0.03, 0.2), between(0.05, 0.9), between(0.3, 2.0),
                          wall.stiffness_n_per_mm, static_cast<Approach>(random() % 4));
    hand.start_mm.z() += between(0.0, kSensorCountMm);
    const LoopResult result = Touch(hand, wall, loop);
    EXPECT_LE(result.given_mj, 1.0);
    if (hand.tremor_n > 0.0) continue;
    shaken += result.force_swing_n > 0.2;
    EXPECT_NEAR(result.force_n, hand.push_n, 0.05);
  }
  // Not one in a thousand, at 2 N/mm and more, keeps a swing of a few counts.
  EXPECT_LE(shaken, hands / 1000);
}

// A slew limit makes the force act later still.
TEST(Passivity, ASlewLimitIsBorneIfTheWrittenForceIsTold) {
  double untold_mj = 0.0;
  ForEachLightHand([&](const Hand& hand, double stiffness, bool is_late) {
    if (!is_late) return;
    Loop loop{.is_late = is_late, .slew_n = 0.2, .falls_at_once = true};
    Wall wall{.stiffness_n_per_mm = stiffness};
    const LoopResult result = Touch(hand, wall, loop);
    EXPECT_LE(result.given_mj, 1.0);
    loop.falls_at_once = false;
    const LoopResult slow = Touch(hand, wall, loop);
    EXPECT_LE(slow.given_mj, 1.0);
    wall.tells_written = false;
    untold_mj = std::max(untold_mj, Touch(hand, wall, loop).given_mj);
  });
  EXPECT_GT(untold_mj, 10.0);
}

TEST(Passivity, ADampedHandFeelsTheSpringAsItIs) {
  for (double stiffness : {0.3, 0.5}) {  // up to kSafeNPerMm
    Change change;
    for (bool is_late : {false, true}) {
      for (double mass_kg : {0.03, 0.1, 0.2}) {
        for (double times : {4.0, 8.0}) {
          for (double push_n : {0.3, 1.0, 2.0}) {
            Hand hand = LightHand(mass_kg, times, push_n, stiffness, Approach::kRest);
            Touch(hand, {.stiffness_n_per_mm = stiffness}, {.is_late = is_late}, change);
          }
        }
      }
    }
    EXPECT_LT(change.changed, 0.01 * change.ticks) << stiffness;
    EXPECT_LT(change.share, 0.01 * change.ticks) << stiffness;
  }
}

// Above kSafeNPerMm flicker and vibration look the same: the wall softens, but not
// below that.
TEST(Passivity, ASensorThatFlickersDoesNotMakeTheWallCreep) {
  for (double stiffness : {0.3, 0.5, 1.0, 2.0, 3.0}) {
    const double settled_mm = 1.0 / std::min(stiffness, kSafeNPerMm);
    for (int flicker_ticks : {2, 3, 4, 7, 50}) {
      const Hand hand{.damping_n_s_per_m = 6.0, .push_n = 1.0, .start_mm = Vec3(0, 0, 0.01)};
      const LoopResult result = Touch(hand, {.stiffness_n_per_mm = stiffness},
                                      {.seconds = 20.0, .flicker_ticks = flicker_ticks});
      EXPECT_LT(result.depth_mm, settled_mm + kSensorCountMm) << stiffness << " " << flicker_ticks;
      EXPECT_NEAR(result.force_n, 1.0, 0.02) << stiffness << " " << flicker_ticks;
    }
  }
}

// A Falcon's count is more than an Omni's: taken for an Omni's, its flicker is a vibration.
TEST(Passivity, TheCountIsTheDevicesOwn) {
  constexpr double kFalconCountMm = 25.4 / 400.0;
  const PassivityDevice omni, falcon{.resolution_mm = kFalconCountMm};
  double own_mm = 0.0, other_mm = 0.0;  // beyond where the wall settles
  for (double stiffness : {0.3, 0.5}) {
    for (int flicker_ticks : {2, 3, 4, 7}) {
      const Hand hand{.damping_n_s_per_m = 6.0, .push_n = 1.0, .start_mm = Vec3(0, 0, 0.01)};
      const Loop loop{.seconds = 20.0, .flicker_ticks = flicker_ticks, .count_mm = kFalconCountMm};
      const auto beyond_mm = [&](const PassivityDevice& device) {
        const Wall wall{.stiffness_n_per_mm = stiffness, .device = device};
        return Touch(hand, wall, loop).depth_mm - 1.0 / stiffness;
      };
      own_mm = std::max(own_mm, beyond_mm(falcon));
      other_mm = std::max(other_mm, beyond_mm(omni));
    }
  }
  EXPECT_LT(own_mm, kFalconCountMm);
  EXPECT_GT(other_mm, 2.0 * kFalconCountMm);
}

TEST(Passivity, TheGreatestForceIsTheDevicesOwn) {
  for (const double max_force_n : {1.0, 3.3, 8.0}) {
    const PassivityDevice device{.max_force_n = max_force_n};
    PassivityState state;
    const auto tick = [&](double depth_mm) {
      return LimitToPassive(Vec3(0, 0, 20), 1.0, depth_mm, Vec3(0, 0, -20), 1e3, kLoopTickS, device,
                            state);
    };
    EXPECT_NEAR(tick(0.0).norm(), max_force_n, 1e-12);
    EXPECT_NEAR(tick(20.0).norm(), max_force_n, 1e-12);  // the tank is full
  }
}

// The HIP rests while the surface rises by 2 mm, then is pushed back by it.
double ScaleAfterSurfaceRose(bool is_budgeted) {
  PassivityState state;
  const double stiffness = 1.0;
  double least = 1.0;
  const auto tick = [&](double surface_mm, double hip_mm, double budget_mj) {
    const double depth_mm = std::max(0.0, surface_mm - hip_mm);
    LimitToPassive(Vec3(0, 0, stiffness * depth_mm), stiffness, depth_mm, Vec3(0, 0, hip_mm),
                   budget_mj, kLoopTickS, {}, state);
    least = std::min(least, state.scale);
  };
  double stored_mj = 0.0;
  for (int n = 0; n < 200; ++n) {
    const double depth_mm = 0.01 * n;
    const double now_mj = 0.5 * stiffness * depth_mm * depth_mm;
    tick(depth_mm, 0.0, is_budgeted ? now_mj - stored_mj : 0.0);
    stored_mj = now_mj;
  }
  for (int n = 0; n < 200; ++n) tick(2.0, 0.01 * n, 0.0);
  return least;
}

TEST(Passivity, ASurfaceThatMovesIsSeenUnlessItIsBudgeted) {
  EXPECT_LT(ScaleAfterSurfaceRose(false), 0.6);
  EXPECT_GT(ScaleAfterSurfaceRose(true), 0.99);
}

TEST(Passivity, WhatWasDissipatedIsNotGivenBack) {
  PassivityState state;
  // Dragged through free space against 1 N, then 1 mm into a wall that drags too.
  for (int n = 0; n < 100; ++n) {
    LimitToPassive(Vec3(-1, 0, 0), 1.0, 0.0, Vec3(0.1 * n, 0, 0), 0.0, kLoopTickS, {}, state);
  }
  EXPECT_LE(state.tank_mj, 0.0);
  for (int n = 0; n < 100; ++n) {
    LimitToPassive(Vec3(-1, 0, 1), 1.0, 1.0, Vec3(10 + 0.1 * n, 0, -1), 0.0, kLoopTickS, {}, state);
  }
  EXPECT_GT(state.tank_mj, 0.0);
  EXPECT_LE(state.tank_mj, 0.5 * 1.0 * 1.0 * 1.0);
}

TEST(Passivity, StiffnessComesBackOutOfContact) {
  PassivityState state;
  state.distrust = 1.0;
  for (int n = 0; n < 2000; ++n) {
    LimitToPassive(Vec3::Zero(), 2.0, 0.0, Vec3(0, 0, 5), 0.0, kLoopTickS, {}, state);
  }
  EXPECT_GT(state.scale, 0.99);
}

TEST(Passivity, AnyFiniteInputGivesAFiniteForceWithinTheLimit) {
  std::mt19937_64 random(5);
  const double inf = std::numeric_limits<double>::infinity();
  const auto number = [&] {
    const double sign = random() % 2 ? 1.0 : -1.0;
    const double powers[] = {0.0, 1e-320, 1e-30, 1e-3, 0.1, 1.0, 30.0, 1e5, 1e160, 1.7e308};
    return sign * powers[random() % 10] * std::uniform_real_distribution<double>(0, 1)(random);
  };
  PassivityState state;
  for (int n = 0; n < test::Scaled(400'000); ++n) {
    const bool is_wild = n / 100 % 2 == 0;
    const Vec3 force(number(), number(), is_wild ? number() : 1.0);
    const Vec3 hip(is_wild ? number() : 0.1, 1.0, 2.0 + std::sin(n * 0.1));
    const Vec3 out = LimitToPassive(force, number(), number(), hip, is_wild ? number() : 0.0,
                                    is_wild ? number() : kLoopTickS, {}, state);
    ASSERT_TRUE(out.allFinite());
    ASSERT_LE(out.norm(), testing::kDeviceForceN * 1.0001);
  }
  EXPECT_TRUE(LimitToPassive(Vec3(0, 0, inf), 1, 1, Vec3::Zero(), 0, 1e-3, {}, state).isZero());
  EXPECT_TRUE(LimitToPassive(Vec3(0, 0, 1), 1, 1, Vec3(0, -inf, 0), 0, 1e-3, {}, state).isZero());
  EXPECT_TRUE(LimitToPassive(Vec3(0, 0, 1), 1, 1, Vec3::Zero(), 0, 0.0, {}, state).isZero());
  // And it is not stuck.
  state = {};
  EXPECT_EQ(LimitToPassive(Vec3(0, 0, 0.1), 1, 0.1, Vec3::Zero(), 0, 1e-3, {}, state),
            Vec3(0, 0, 0.1));
}

}  // namespace
}  // namespace palpate
