// Passivity control on surfaces of volumes, with the proxy in the loop.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
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

// The whole chain as the servo runs it: renderer, force limit, slew limit.
struct Chain {
  Vec3 Tick(const Vec3& p_DHip_mm, double dt_s) {
    const HapticOutput output = StepRenderer(surface, settings, p_DHip_mm, dt_s, *state);
    const Vec3 written_n = safety.Step({.force_D_n = output.force_D_n}, kLoopTickS);
    TellWrittenForce(written_n, *state);
    return written_n;
  }

  testing::PlacedVolume sphere = testing::PlaceBuiltin("builtin:sphere:64", 0.5);
  HapticSurface& surface = sphere.surface;
  HapticSettings settings;
  std::unique_ptr<RendererState> state = std::make_unique<RendererState>();
  Safety safety{SafetyLimits{}};
};

LoopResult TouchThroughChain(const Hand& hand, const HapticSettings& settings) {
  Chain chain;
  chain.settings = settings;
  return HandLoop(hand, {.seconds = 5.0})
      .Run([&](const Vec3& p, double dt_s, const Vec3&) { return chain.Tick(p, dt_s); },
           [&](const Vec3& p) { return p.norm(); });
}

TEST(PassivitySurface, TheWholeChainGivesNoEnergy) {
  for (const double push_n : {0.5, 1.0, 2.0}) {
    for (const double share : {0.05, 0.9}) {
      const Hand hand{.mass_kg = 0.1,
                      .damping_n_s_per_m = share,  // K T / 2 is 1 N s/m
                      .push_n = push_n,
                      .start_mm = Vec3(6.0, 7.0, 14.0),
                      .aim_mm = Vec3::Zero()};
      HapticSettings settings{.stiffness_n_per_mm = 2.0};
      const double plain_mj = TouchThroughChain(hand, settings).given_mj;
      settings.passivity_control = true;
      const LoopResult result = TouchThroughChain(hand, settings);
      EXPECT_GT(plain_mj, 2.0);
      EXPECT_LE(result.given_mj, 1.0);
      EXPECT_LE(0.5 * result.force_swing_n, 0.1);  // its amplitude
      EXPECT_NEAR(result.force_n, push_n, 0.05);
    }
  }
}

// A wall that swells and sinks works on the hand; that is not the spring's debt.
TEST(PassivitySurface, AMovingSurfaceAndAMagnetAreNotTakenForDebts) {
  Chain chain;
  chain.settings = {.stiffness_n_per_mm = 0.5,
                    .magnet_force_n = 0.5,
                    .magnet_range_mm = 2.0,
                    .passivity_control = true};
  const Hand hand{.mass_kg = 0.1,
                  .damping_n_s_per_m = 4.0,
                  .push_n = 0.6,
                  .start_mm = Vec3(6.0, 7.0, 14.0),
                  .aim_mm = Vec3::Zero()};
  long tick = 0;
  double least_scale = 1.0;
  const LoopResult result =
      HandLoop(hand, {.seconds = 8.0})
          .Run(
              [&](const Vec3& p, double dt_s, const Vec3&) {
                chain.surface.isovalue = 0.5 + 0.06 * std::sin(2e-3 * static_cast<double>(++tick));
                const Vec3 force_n = chain.Tick(p, dt_s);
                least_scale = std::min(least_scale, chain.state->passivity.scale);
                return force_n;
              },
              [](const Vec3& p) { return p.norm(); });
  EXPECT_GT(result.given_mj, 0.05);  // the surface did move it
  EXPECT_GT(least_scale, 0.9);
}

// The surface trembles by next to nothing, or the data have a new revision, in every
// tick: that must not switch the control off.
TEST(PassivitySurface, NoTrembleOfTheSurfaceFeedsAHand) {
  for (const int tremble : {0, 1, 2}) {
    Chain chain;
    chain.settings = {.stiffness_n_per_mm = 2.0, .passivity_control = true};
    const Hand hand{.mass_kg = 0.1,
                    .damping_n_s_per_m = 0.1,
                    .push_n = 1.0,
                    .start_mm = Vec3(6.0, 7.0, 14.0),
                    .aim_mm = Vec3::Zero()};
    long tick = 0;
    const auto render = [&](const Vec3& p, double dt_s, const Vec3&) {
      ++tick;
      if (tremble == 0) chain.surface.isovalue = 0.5 + (tick % 2 ? 1e-9 : -1e-9);
      if (tremble == 1) {
        chain.surface.isovalue = 0.5 + 1e-5 * std::sin(0.01 * static_cast<double>(tick));
      }
      if (tremble == 2) ++chain.surface.geometry_revision;
      return chain.Tick(p, dt_s);
    };
    const LoopResult result =
        HandLoop(hand, {.seconds = 5.0}).Run(render, [](const Vec3& p) { return p.norm(); });
    EXPECT_LE(result.given_mj, 1.0);
    EXPECT_LE(0.5 * result.force_swing_n, 0.1);
  }
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
