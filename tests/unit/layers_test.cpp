// Layers on exact geometry: where they hold, at which forces they let the stylus pass, and what the
// hand gets of it.
#include "server/haptics/haptic_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "server/haptics/renderer.h"
#include "tests/support/layered.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using testing::LayersOf;

constexpr double kTickS = 1e-3;

// Density 0 at z = 40 to 1 at z = 0, voxels of 1 mm: a layer of isovalue τ is the plane z = 40 - 40
// τ.
class PlaneLayers : public ::testing::Test {
 protected:
  static double Height(double isovalue) { return 40.0 - 40.0 * isovalue; }
  HapticOutput Step(double z_mm) {
    surface_.layers = &layers_;
    return StepRenderer(surface_, settings_, Vec3(4.2, 4.1, z_mm), kTickS, *state_);
  }

  // The energy that the hand gets on a way down to `low_mm` and back, in mJ. By the mean of the
  // forces at both ends of a step: what the sampling adds is passivity control's subject.
  double Press(double high_mm, double low_mm, double step_mm) {
    double given_mj = 0.0, z = high_mm, force_n = Step(z).force_D_n.z();
    const int steps = static_cast<int>((high_mm - low_mm) / step_mm);
    for (int n = 0; n < 2 * steps; ++n) {
      const double moved_mm = n < steps ? -step_mm : step_mm;
      z += moved_mm;
      const HapticOutput output = Step(z);
      pops_ += output.popped;
      const double change_n = output.force_D_n.z() - force_n;
      greatest_change_n_ = std::max(greatest_change_n_, std::abs(change_n));
      given_mj += (force_n + 0.5 * change_n) * moved_mm;
      force_n += change_n;
    }
    return given_mj;
  }

  std::shared_ptr<const VolumeSnapshot> volume_ =
      testing::MakeVolume(Vec3i(9, 9, 41), [](int, int, int k) { return (40.0 - k) / 40.0; });
  HapticSurface surface_ =
      MakeHapticSurface(*volume_, AffineMap{}, 0.5, DecompositionMethod::kTpbcc, 1);
  // Skin at 30 mm over bone at 20 mm.
  HapticLayers layers_ = LayersOf(
      {{.id = 3, .isovalue = 0.25, .stiffness_n_per_mm = 0.4, .pop_in_n = 1.0, .pop_out_n = 0.5},
       {.id = 1, .isovalue = 0.5, .stiffness_n_per_mm = 1.5}});
  HapticSettings settings_{};
  std::unique_ptr<RendererState> state_ = std::make_unique<RendererState>();
  int pops_ = 0;
  double greatest_change_n_ = 0.0;
};

TEST_F(PlaneLayers, EachPopsAtItsForceAndBoneHolds) {
  double last_n = 0.0, z = 35.0;
  HapticOutput output = Step(z);
  while (!output.popped) {
    last_n = output.spring_D_n.norm();
    output = Step(z -= 0.001);
    ASSERT_GT(z, 20.0);
  }
  EXPECT_NEAR(last_n, 1.0, 0.01);
  EXPECT_NEAR(z, Height(0.25) - 1.0 / 0.4, 0.003);
  EXPECT_EQ(output.proxy.mode, ProxyMode::kFree);
  EXPECT_EQ(output.layers_passed, 1);
  // Free between skin and bone, then held by bone, however hard the hand presses.
  for (; z > 5.0; z -= 0.01) output = Step(z);
  EXPECT_EQ(output.contact_layer, 1);
  EXPECT_EQ(output.layers_passed, 1);
  EXPECT_NEAR(output.proxy.p_DH_mm.z(), Height(0.5), 1e-6);
  EXPECT_NEAR(output.spring_D_n.z(), 1.5 * (Height(0.5) - z - 0.01), 0.02);
  // Back out: skin holds from within, at its own force outwards.
  for (; z < 29.9; z += 0.01) output = Step(z);
  EXPECT_EQ(output.contact_layer, 0);
  while (!output.popped) {
    last_n = output.spring_D_n.norm();
    output = Step(z += 0.001);
    ASSERT_LT(z, 40.0);
  }
  EXPECT_NEAR(last_n, 0.5, 0.005);
  EXPECT_NEAR(z, Height(0.25) + 0.5 / 0.4, 0.003);
  EXPECT_EQ(output.layers_passed, 0);
}

// A spring over a stiffer one would climb by itself when skin gives way.
TEST_F(PlaneLayers, AStifferLayerRightBelowTakesOverAtTheForceOfThePop) {
  for (const double gap : {1e-6, 5e-4}) {
    layers_.layer[1].isovalue = 0.25 + gap;
    state_ = std::make_unique<RendererState>();
    double z = 31.0, last_n = 0.0;
    HapticOutput output = Step(z);
    for (; !output.popped; output = Step(z -= 0.005)) {
      last_n = output.force_D_n.z();
      ASSERT_GT(z, 20.0);
    }
    EXPECT_EQ(output.contact_layer, 1);
    EXPECT_NEAR(output.force_D_n.z(), last_n, 1.5 * 0.006);
    for (int n = 0; n < 60; ++n) output = Step(z);
    EXPECT_NEAR(output.force_D_n.z(), last_n, 1.5 * 0.006);
    // From here on, bone's own stiffness.
    output = Step(z - 0.1);
    EXPECT_NEAR(output.force_D_n.z(), last_n + 0.15, 1.5 * 0.006);
  }
}

TEST_F(PlaneLayers, NoPressGivesEnergy) {
  const double stiffness[] = {0.2, 0.5, 2.0};
  for (const double skin : stiffness) {
    for (const double bone : stiffness) {
      for (const double bone_pop_n : {0.0, 1.5}) {
        for (const double gap : {5e-4, 0.01, 0.1}) {
          for (const double step_mm : {0.005, 0.05}) {
            SCOPED_TRACE(::testing::Message() << skin << " over " << bone << " N/mm, pops at "
                                              << bone_pop_n << " N, gap " << gap);
            layers_ = LayersOf({{.id = 1,
                                 .isovalue = 0.25,
                                 .stiffness_n_per_mm = skin,
                                 .pop_in_n = 1.0,
                                 .pop_out_n = 0.4},
                                {.id = 2,
                                 .isovalue = 0.25 + gap,
                                 .stiffness_n_per_mm = bone,
                                 .pop_in_n = bone_pop_n,
                                 .pop_out_n = bone_pop_n}});
            state_ = std::make_unique<RendererState>();
            pops_ = 0;
            greatest_change_n_ = 0.0;
            EXPECT_LE(Press(39.0, 18.0, step_mm), 0.0);
            EXPECT_GE(pops_, 2);
            // The greatest pop's force fades in 30 ticks; the spring follows the hand.
            EXPECT_LT(greatest_change_n_, 1.6 / 30.0 + std::max(skin, bone) * step_mm + 1e-9);
          }
        }
      }
    }
  }
}

// At most one layer is passed in a tick, so each is felt.
TEST_F(PlaneLayers, ThreeThinOnesAreFeltOneByOne) {
  layers_ = LayersOf({{.id = 1, .isovalue = 0.25, .pop_in_n = 0.3, .pop_out_n = 0.3},
                      {.id = 2, .isovalue = 0.2501, .pop_in_n = 0.6, .pop_out_n = 0.3},
                      {.id = 3, .isovalue = 0.2502, .pop_in_n = 0.9, .pop_out_n = 0.3}});
  std::vector<double> forces_n;
  double last_n = 0.0;
  for (double z = 31.0; z > 25.0; z -= 0.002) {
    const HapticOutput output = Step(z);
    if (output.popped) forces_n.push_back(last_n);
    last_n = output.spring_D_n.norm();
  }
  ASSERT_EQ(forces_n.size(), 3u);
  for (int n = 0; n < 3; ++n)
    EXPECT_NEAR(forces_n[static_cast<std::size_t>(n)], 0.3 * (n + 1), 0.01);
}

TEST_F(PlaneLayers, AnIdStaysPassedWhileItsLayerMoves) {
  for (double z = 35.0; z > 27.0; z -= 0.01) Step(z);
  EXPECT_EQ(Step(27.0).layers_passed, 1);
  layers_.layer[0].isovalue = 0.3;  // to z = 28
  EXPECT_EQ(Step(27.0).layers_passed, 1);
  // Bone comes over skin: of the new order, nothing was passed.
  std::swap(layers_.layer[0], layers_.layer[1]);
  layers_.layer[0].isovalue = 0.29;
  const HapticOutput moved = Step(27.0);
  EXPECT_EQ(moved.layers_passed, 0);
  EXPECT_EQ(moved.contact_layer, 1);
  EXPECT_NEAR(moved.proxy.density, 0.29, 1e-12);
  // Skin cannot be passed any more: it holds from outside.
  layers_ = LayersOf({{.id = 3, .isovalue = 0.25, .pop_in_n = 1.0, .pop_out_n = 1.0}});
  for (double z = 35.0; z > 25.0; z -= 0.01) Step(z);
  EXPECT_EQ(Step(25.0).layers_passed, 1);
  layers_.layer[0].pop_in_n = 0.0;
  EXPECT_EQ(Step(29.9).layers_passed, 0);
}

TEST_F(PlaneLayers, WhereTheVolumeIsPutAnewALayerHoldsFromWithinAsBefore) {
  layers_.layer[0].pop_out_n = 0.0;
  for (double z = 35.0; z > 25.0; z -= 0.01) Step(z);
  for (double z = 25.0; z < 31.0; z += 0.01) Step(z);
  ++surface_.geometry_revision;
  const HapticOutput output = Step(31.0);
  EXPECT_EQ(output.layers_passed, 1);
  EXPECT_NEAR(output.force_D_n.z(), -0.4, 1e-6);
}

TEST_F(PlaneLayers, WhatPassedTheOneSurfaceHasPassedNoLayer) {
  settings_.pop_force_n = 1.0;
  bool popped = false;
  for (double z = 25.0; z > 15.0; z -= 0.01) {
    popped |= StepRenderer(surface_, settings_, Vec3(4.2, 4.1, z), kTickS, *state_).popped;
  }
  EXPECT_TRUE(popped);
  layers_ = LayersOf({{.id = 1, .isovalue = 0.9, .pop_in_n = 1.0}});
  const HapticOutput above_it = Step(15.0);
  EXPECT_EQ(above_it.layers_passed, 0);
  EXPECT_EQ(above_it.contact_layer, 0);
}

TEST_F(PlaneLayers, BehindALayerItsViscosityIsFelt) {
  settings_.viscosity_n_s_per_m = 1.0;
  layers_.layer[0].viscosity_n_s_per_m = 4.0;
  const auto drag_n = [&](double z_mm) {
    Vec3 hip(4.2, 4.1, z_mm);
    HapticOutput output;
    for (int n = 0; n < 200; ++n) {
      hip.x() += 0.01;  // 10 mm/s
      output = StepRenderer(surface_, settings_, hip, kTickS, *state_);
    }
    EXPECT_EQ(output.contact_layer, 0);
    return -output.force_D_n.x();
  };
  Step(35.0);
  EXPECT_NEAR(drag_n(35.0), 0.01, 1e-6);
  for (double z = 35.0; z > 25.0; z -= 0.01) Step(z);
  EXPECT_NEAR(drag_n(25.0), 0.04, 1e-6);
}

// Where one layer is all there is, the one surface of the settings is felt, to the bit.
TEST(Layers, OneAloneIsTheSurfaceOfTheSettings) {
  const auto volume = testing::Gyroid();
  const HapticSurface plain =
      MakeHapticSurface(*volume, AffineMap{}, 0.47, DecompositionMethod::kTpbcc, 1);
  const HapticSettings settings{.stiffness_n_per_mm = 0.8,
                                .damping_n_s_per_m = 0.7,
                                .static_friction = 0.4,
                                .dynamic_friction = 0.3,
                                .passivity_control = true};
  const HapticLayers one = LayersOf({{.id = 5,
                                      .isovalue = 0.47,
                                      .stiffness_n_per_mm = 0.8,
                                      .damping_n_s_per_m = 0.7,
                                      .static_friction = 0.4,
                                      .dynamic_friction = 0.3}});
  HapticSurface layered = plain;
  layered.layers = &one;
  auto a = std::make_unique<RendererState>(), b = std::make_unique<RendererState>();
  int contacts = 0;
  for (int n = 0; n < 5000; ++n) {
    const double s = 0.002 * n;
    const Vec3 hip =
        Vec3::Constant(24.0) + 20.0 * Vec3(std::sin(s), std::cos(1.3 * s), std::sin(2.1 * s + 1.0));
    const HapticOutput of_settings = StepRenderer(plain, settings, hip, kTickS, *a);
    const HapticOutput of_layer = StepRenderer(layered, settings, hip, kTickS, *b);
    ASSERT_EQ(of_settings.proxy.p_DH_mm, of_layer.proxy.p_DH_mm) << n;
    ASSERT_EQ(of_settings.force_D_n, of_layer.force_D_n) << n;
    contacts += of_layer.contact_layer == 5;
  }
  EXPECT_GT(contacts, 1000);
}

}  // namespace
}  // namespace palpate
