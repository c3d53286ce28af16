// Passivity control on surfaces of volumes, with the proxy in the loop.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "server/haptics/passivity.h"
#include "server/haptics/renderer.h"
#include "server/safety/safety.h"
#include "tests/support/hand_loop.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

using testing::Hand;
using testing::HandLoop;
using testing::kLoopTickS;
using testing::LoopResult;

// The whole chain as the servo runs it: renderer, force limit, slew limit. Next to a sphere.
struct Chain {
  explicit Chain(const HapticSettings& of_chain) : settings(of_chain) {
    surface.Refine(static_cast<int>(settings.refinement));
  }

  Vec3 Tick(const Vec3& p_DHip_mm, double dt_s, bool suspended = false) {
    const HapticOutput output = suspended
                                    ? SuspendRenderer(p_DHip_mm, dt_s, *state)
                                    : StepRenderer(surface, settings, p_DHip_mm, dt_s, *state);
    const Vec3 written_n =
        safety.Step({.wrench_D = {output.force_D_n}, .suspended = suspended}, kLoopTickS).force_n;
    TellWrittenForce(written_n, *state);
    return written_n;
  }
  // before_tick(time_s) says whether the tick is suspended.
  LoopResult Touch(
      const Hand& hand, double seconds,
      const std::function<bool(double)>& before_tick = [](double) { return false; }) {
    double time_s = 0.0;
    return HandLoop(hand, {.seconds = seconds})
        .Run(
            [&](const Vec3& p, double dt_s, const Vec3&) {
              time_s += dt_s;
              return Tick(p, dt_s, before_tick(time_s));
            },
            [](const Vec3& p) { return p.norm(); });
  }

  testing::PlacedVolume sphere = testing::PlaceBuiltin("builtin:sphere:64", 0.5);
  HapticSurface& surface = sphere.surface;
  HapticSettings settings;
  std::unique_ptr<RendererState> state = std::make_unique<RendererState>();
  Safety safety{SafetyLimits{}};
};

Hand TowardsTheMiddle(double damping_n_s_per_m, double push_n,
                      const Vec3& start_mm = Vec3(6.0, 7.0, 14.0)) {
  return {.mass_kg = 0.1,
          .damping_n_s_per_m = damping_n_s_per_m,
          .push_n = push_n,
          .start_mm = start_mm,
          .aim_mm = Vec3::Zero()};
}

TEST(PassivitySurface, TheWholeChainGivesNoEnergy) {
  for (const double push_n : {0.5, 1.0, 2.0}) {
    for (const double share : {0.05, 0.9}) {  // K T / 2 is 1 N s/m
      for (const double refinement : {1.0, 2.0}) {
        const Hand hand = TowardsTheMiddle(share, push_n);
        HapticSettings settings{.stiffness_n_per_mm = 2.0};
        settings.refinement = refinement;
        EXPECT_GT(Chain(settings).Touch(hand, 5.0).given_mj, 2.0);
        settings.passivity_control = true;
        const LoopResult result = Chain(settings).Touch(hand, 5.0);
        EXPECT_LE(result.given_mj, 1.0);
        EXPECT_LE(0.5 * result.force_swing_n, 0.1);  // its amplitude
        EXPECT_NEAR(result.force_n, push_n, 0.05);
      }
    }
  }
}

// A wall that swells and sinks works on the hand; that is not the spring's debt.
TEST(PassivitySurface, AMovingSurfaceAndAMagnetAreNotTakenForDebts) {
  Chain chain({.stiffness_n_per_mm = 0.5,
               .magnet_force_n = 0.5,
               .magnet_range_mm = 2.0,
               .passivity_control = true});
  double least_scale = 1.0;
  const LoopResult result = chain.Touch(TowardsTheMiddle(4.0, 0.6), 8.0, [&](double time_s) {
    least_scale = std::min(least_scale, chain.state->passivity.scale);
    chain.surface.isovalue = 0.5 + 0.06 * std::sin(2.0 * time_s);
    return false;
  });
  EXPECT_GT(result.given_mj, 0.05);  // the surface did move it
  EXPECT_GT(least_scale, 0.9);
}

// The surface trembles by next to nothing, or the data have a new revision, in every
// tick: that must not switch the control off.
TEST(PassivitySurface, NoTrembleOfTheSurfaceFeedsAHand) {
  for (const int tremble : {0, 1, 2}) {
    Chain chain({.stiffness_n_per_mm = 2.0, .passivity_control = true});
    int tick = 0;
    const LoopResult result = chain.Touch(TowardsTheMiddle(0.1, 1.0), 5.0, [&](double time_s) {
      if (tremble == 0) chain.surface.isovalue = 0.5 + (++tick % 2 ? 1e-9 : -1e-9);
      if (tremble == 1) chain.surface.isovalue = 0.5 + 1e-5 * std::sin(10.0 * time_s);
      if (tremble == 2) ++chain.surface.geometry_revision;
      return false;
    });
    EXPECT_LE(result.given_mj, 1.0);
    EXPECT_LE(0.5 * result.force_swing_n, 0.1);
  }
}

// Let go deep in the material, a hand gets no more energy than the credit.
TEST(PassivitySurface, AResumeGivesAHandNoMoreThanTheCredit) {
  const auto given_mj = [](double stiffness_n_per_mm, double depth_mm, bool is_controlled) {
    Chain chain({.stiffness_n_per_mm = stiffness_n_per_mm, .passivity_control = is_controlled});
    const Hand hand = TowardsTheMiddle(0.1, 1e-6, Vec3(0.2, 0.1, 12.5 - depth_mm));
    return chain.Touch(hand, 3.0, [](double time_s) { return time_s < 0.1; }).given_mj;
  };
  double plain_mj = 0.0;
  for (const double stiffness : {0.5, 2.0, 3.0}) {
    for (const double depth_mm : {0.5, 2.0, 5.0}) {
      EXPECT_LE(given_mj(stiffness, depth_mm, true), 1.0)
          << stiffness << " N/mm, " << depth_mm << " mm";
      plain_mj = std::max(plain_mj, given_mj(stiffness, depth_mm, false));
    }
  }
  // The ramp after the suspension is not enough.
  EXPECT_GT(plain_mj, 1.0);
}

// The HIP is led along a circle 1 mm below the mean sphere, at 10 cm/s.
TEST(PassivitySurface, ASlideOnBumpsKeepsItsForce) {
  const double stiffness = 0.5;  // below kSafeNPerMm
  for (double mm_per_voxel : {0.5, 2.0}) {
    const testing::PlacedVolume bumps = testing::PlaceBuiltin("builtin:bumps:64", mm_per_voxel);
    const double radius_mm = 0.39 * 64.0 * mm_per_voxel - 1.0;
    for (bool is_quantised : {false, true}) {
      Proxy proxy;
      CellCache cache;
      PassivityState state;
      long ticks = 0;
      double lost = 0.0, off = 0.0;  // shares of the force: along it, and drag included
      for (int n = 0; n < 20'000; ++n) {
        const double angle = n * kLoopTickS * 100.0 / radius_mm;
        // Along a tilted circle, reached from outside.
        const double r_mm = radius_mm + std::max(0.0, 3.0 - 0.01 * n);
        Vec3 hip = r_mm * Vec3(std::cos(angle), 0.8 * std::sin(angle), 0.6 * std::sin(angle));
        if (is_quantised) {
          hip = (hip / testing::kSensorCountMm).array().round() * testing::kSensorCountMm;
        }
        const Vec3 push_mm = StepProxy(bumps.surface, hip, 1e9, proxy, cache).p_DH_mm - hip;
        const Vec3 plain_n = stiffness * push_mm;
        const Vec3 force_n =
            LimitToPassive(plain_n, stiffness, push_mm.norm(), hip, 0.0, kLoopTickS, {}, state);
        if (n < 1000 || plain_n.isZero()) continue;
        ++ticks;
        lost += 1.0 - force_n.dot(plain_n) / plain_n.squaredNorm();
        off += (force_n - plain_n).norm() / plain_n.norm();
      }
      ASSERT_GT(ticks, 15'000);
      EXPECT_LT(std::abs(lost), 0.01 * ticks) << mm_per_voxel;
      EXPECT_LT(off, 0.1 * ticks) << mm_per_voxel;
    }
  }
}

}  // namespace
}  // namespace palpate
