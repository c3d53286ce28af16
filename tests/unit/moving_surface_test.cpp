// The surface moves under the stylus: isovalue, data, whole volumes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "server/haptics/renderer.h"
#include "server/safety/safety.h"
#include "server/servo/tick_computation.h"
#include "tests/support/made_volume.h"
#include "tests/support/scaled.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

constexpr double kTickS = 1e-3;
constexpr int kEdge = 32;
const Vec3 kCentre = Vec3::Constant((kEdge - 1) / 2.0);
const auto kSeeds = static_cast<std::uint64_t>(test::Scaled(20));

// A ball whose radius is RadiusAt(isovalue); `extra` is added to its density.
std::shared_ptr<const VolumeSnapshot> Ball(const std::function<double(const Vec3&)>& extra =
                                               [](const Vec3&) { return 0.0; }) {
  return testing::MakeVolume(Vec3i::Constant(kEdge), [&](int i, int j, int k) {
    const Vec3 p(i, j, k);
    // Corners that fix the range, whatever the rest is.
    if (i + j + k == 0) return 0.0;
    if (i + j + k == 3 * (kEdge - 1)) return 1.0;
    const double d = 0.5 - ((p - kCentre).norm() - 11.0) / 32.0 + extra(p);
    return std::clamp(d, 0.0, 1.0);
  });
}

double RadiusAt(double isovalue) { return 11.0 + 32.0 * (0.5 - isovalue); }

struct Stylus {
  HapticSettings settings{.stiffness_n_per_mm = 0.5};
  std::unique_ptr<RendererState> state = std::make_unique<RendererState>();
  Safety safety{SafetyLimits{}};
  Vec3 force_n = Vec3::Zero();
  double greatest_step_n = 0.0;

  HapticOutput Step(const VolumeSnapshot& volume, double isovalue, std::uint64_t revision,
                    const Vec3& hip) {
    const HapticSurface surface =
        MakeHapticSurface(volume, AffineMap{}, isovalue, DecompositionMethod::kTpbcc, revision);
    const HapticOutput output = StepRenderer(surface, settings, hip, kTickS, *state);
    const Vec3 written_n = safety.Step({.wrench_D = {output.force_D_n}}, kTickS).force_n;
    greatest_step_n = std::max(greatest_step_n, (written_n - force_n).norm());
    force_n = written_n;
    return output;
  }
};

TEST(MovingSurface, AStepOfTheIsovalueIsFeltInTheSameTickAndEjectingEnds) {
  const auto volume = Ball();
  Stylus stylus;
  const Vec3 hip = kCentre + Vec3(9.0, 0.5, 0.2);
  stylus.Step(*volume, 0.5, 1, kCentre + Vec3(15, 0, 0));
  for (int n = 0; n < 100; ++n) stylus.Step(*volume, 0.5, 1, hip);
  HapticOutput output = stylus.Step(*volume, 0.4, 1, hip);  // 3.2 mm of new material
  EXPECT_EQ(output.proxy.mode, ProxyMode::kEjecting);
  EXPECT_NEAR((output.proxy.p_DH_mm - kCentre).norm(), RadiusAt(0.4), 0.1);
  output = stylus.Step(*volume, 0.4, 1, hip);
  EXPECT_EQ(output.proxy.mode, ProxyMode::kConstrained);
  output = stylus.Step(*volume, 0.6, 1, hip);  // gone from under it
  EXPECT_NE(output.proxy.mode, ProxyMode::kEjecting);
  EXPECT_LE(output.proxy.density, 0.6);
  EXPECT_LE(stylus.greatest_step_n, testing::kMaxStepN);
}

TEST(MovingSurface, CarvingUnderTheProxyLowersItAndAddingLiftsIt) {
  const Vec3 at = kCentre + Vec3(11, 0, 0);
  const Vec3 hip = kCentre + Vec3(8, 0, 0);
  Stylus stylus;
  std::uint64_t revision = 1;
  auto volume = Ball();
  stylus.Step(*volume, 0.5, revision, kCentre + Vec3(15, 0, 0));
  double height = (stylus.Step(*volume, 0.5, revision, hip).proxy.p_DH_mm - kCentre).x();
  // A dent that deepens by steps, then a bump that grows.
  for (double depth : {0.5, 1.0, 1.5, 2.0, 1.0, 0.0, -0.5, -1.0, -2.0}) {
    volume = Ball(
        [&](const Vec3& p) { return -depth / 32.0 * std::exp(-(p - at).squaredNorm() / 50.0); });
    const HapticOutput first = stylus.Step(*volume, 0.5, ++revision, hip);
    ASSERT_LE(first.proxy.density, 0.5) << depth;
    for (int n = 0; n < 60; ++n) {
      const HapticOutput output = stylus.Step(*volume, 0.5, revision, hip);
      ASSERT_LE(output.proxy.density, 0.5);
      ASSERT_EQ(output.proxy.mode, ProxyMode::kConstrained) << depth;
      height = (output.proxy.p_DH_mm - kCentre).x();
    }
    // A bump holds the proxy at its top or lets it slide beside: never below H.
    if (depth >= 0.0) {
      EXPECT_NEAR(height, 11.0 - depth, 0.3) << depth;
    }
  }
  EXPECT_LE(stylus.greatest_step_n, testing::kMaxStepN);
}

TEST(MovingSurface, WhereItVanishesTheStylusIsFree) {
  const auto volume = Ball();
  const auto empty = Ball([](const Vec3&) { return -1.0; });
  Stylus stylus;
  const Vec3 hip = kCentre + Vec3(9, 0, 0);
  stylus.Step(*volume, 0.5, 1, kCentre + Vec3(15, 0, 0));
  for (int n = 0; n < 50; ++n) stylus.Step(*volume, 0.5, 1, hip);
  EXPECT_GT(stylus.force_n.norm(), 0.9);
  const HapticOutput output = stylus.Step(*empty, 0.5, 2, hip);
  EXPECT_EQ(output.proxy.mode, ProxyMode::kFree);
  EXPECT_NEAR((output.proxy.p_DH_mm - hip).norm(), 0.0, 1e-9);
  for (int n = 0; n < 10; ++n) stylus.Step(*empty, 0.5, 2, hip);
  EXPECT_TRUE(stylus.force_n.isZero());
  EXPECT_LE(stylus.greatest_step_n, testing::kMaxStepN);
}

TEST(MovingSurface, AFarSurfaceDoesNotPull) {
  const auto volume = Ball();
  // Solid all over but for a corner far away.
  const auto solid = Ball([](const Vec3& p) { return (p - kCentre).norm() < 24.0 ? 1.0 : -1.0; });
  Stylus stylus;
  stylus.settings.stiffness_n_per_mm = 1.0;  // the cap at 31.5 is 5 mm off: 5 N
  const Vec3 hip = kCentre + Vec3(9, 0, 0);
  stylus.Step(*volume, 0.5, 1, kCentre + Vec3(15, 0, 0));
  for (int n = 0; n < 50; ++n) stylus.Step(*volume, 0.5, 1, hip);
  ProxyMode last = ProxyMode::kFree;
  for (int n = 0; n < 60; ++n) last = stylus.Step(*solid, 0.5, 2, hip).proxy.mode;
  EXPECT_EQ(last, ProxyMode::kInside);
  EXPECT_TRUE(stylus.force_n.isZero());
}

// The tick in which τ changes may start over in every cell.
TEST(MovingSurface, ATickThatChangesTheIsovalueIsShort) {
  const auto volume = Ball();
  Stylus stylus;
  stylus.Step(*volume, 0.5, 1, kCentre + Vec3(15, 0, 0));
  int most = 0;
  for (int n = 0; n < 2000; ++n) {
    const double isovalue = n % 2 ? 0.48 : 0.52;  // 1.3 voxels apart
    const Vec3 hip = kCentre + 9.0 * Vec3(std::cos(n * 1e-3), std::sin(n * 1e-3), 0.1);
    most = std::max(most, stylus.Step(*volume, isovalue, 1, hip).proxy.moves);
  }
  EXPECT_LT(most, 40);  // three tetrahedra a voxel, there and back
}

// --- Random edits

class Editor {
 public:
  explicit Editor(std::uint64_t seed) : random_(seed) {}

  // Other values in a box of up to 6³ voxels; all bricks that it touches are new.
  std::shared_ptr<const VolumeSnapshot> Edit(const VolumeSnapshot& volume, const Vec3i& low) {
    const int edge = std::uniform_int_distribution<int>(1, 6)(random_);
    const Vec3i high = (low + Vec3i::Constant(edge)).cwiseMin(kEdge);
    const bool noise = random_() % 2 == 0;
    const auto flat = static_cast<float>(Share());
    return testing::WithChanges(volume, testing::PaintedBox(volume.bricks(), low, high, [&] {
                                  return noise ? static_cast<float>(Share()) : flat;
                                }));
  }

  double Share() { return std::uniform_real_distribution<double>(0.0, 1.0)(random_); }
  Vec3i Corner() {
    std::uniform_int_distribution<int> any(0, kEdge - 1);
    return {any(random_), any(random_), any(random_)};
  }

 private:
  std::mt19937_64 random_;
};

// It is asked for another refinement all the time, and takes one whenever it is free: then the
// spring is no longer than the way that the hand went, and what H moved.
TEST(MovingSurface, AnotherRefinementWaitsForAFreeHandAndStepsNoForce) {
  const auto volume = testing::Gyroid(24);
  Scene scene;
  scene.volume = volume;
  scene.isovalue = volume->Denormalize(0.5);
  scene.surface = MakeHapticSurface(*volume, AffineMap{}, 0.5, DecompositionMethod::kTpbcc, 1);
  TickComputation computation{SafetyLimits{}};
  std::mt19937_64 random(12);
  std::normal_distribution<double> normal;
  TickInput input;
  input.stylus.calibrated = true;
  input.stylus.p_DHip_mm = Vec3::Constant(12.0);
  TickSample last = computation.Run(scene, input);
  int changes = 0, in_contact = 0, waits = 0;
  for (int n = 0; n < 20'000; ++n) {
    if (n % 10 == 0) scene.surface.Refine(1 + n / 10 % kMaxRefinement);
    for (double& x : input.stylus.p_DHip_mm) x += 0.05 * normal(random) + 0.002 * (12.0 - x);
    const TickSample sample = computation.Run(scene, input);
    changes += sample.refinement != last.refinement;
    in_contact += sample.refinement != last.refinement && last.contact;
    waits += sample.refinement != static_cast<std::uint32_t>(scene.surface.lattice.refinement());
    EXPECT_NE(sample.mode, ProxyMode::kInside);
    const Vec3 hip_mm(sample.hip_mm.data());
    if (sample.refinement != last.refinement) {
      EXPECT_LE((Vec3(sample.scp_h_mm.data()) - hip_mm).norm(),
                (hip_mm - Vec3(last.hip_mm.data())).norm() + 0.05);
    }
    last = sample;
  }
  EXPECT_EQ(in_contact, 0);
  EXPECT_GT(changes, 200);
  EXPECT_GT(waits, 1000);
}

HapticSurface SurfaceOf(const VolumeSnapshot& volume) {
  return MakeHapticSurface(volume, AffineMap{}, 0.5, DecompositionMethod::kTpbcc, 1);
}

TEST(EditedVolume, TheCacheChangesNothingAndNoEditLeavesTheProxyInside) {
  const HapticSettings settings{.stiffness_n_per_mm = 0.5};
  long contacts = 0, ejecting = 0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    Editor editor(seed);
    auto volume = Ball();
    auto lasting = std::make_unique<RendererState>(), fresh = std::make_unique<RendererState>();
    Vec3 hip = kCentre + Vec3(15, 0, 0);
    for (int n = 0; n < 1500; ++n) {
      if (editor.Share() < 0.3) {
        // Every other one where the proxy is.
        const Vec3 near = fresh->proxy.p_DH_mm - Vec3::Constant(2.0);
        const Vec3i low =
            n % 2 == 0 ? editor.Corner() : Vec3i(near.cast<int>().cwiseMax(0).cwiseMin(kEdge - 1));
        volume = editor.Edit(*volume, low);
      }
      const Vec3 aim = kCentre + 10.0 * Vec3(std::cos(n * 7e-3), std::sin(n * 5e-3), 0.3);
      hip += 0.1 * (aim - hip) + 0.1 * Vec3(editor.Share(), editor.Share(), editor.Share());
      const HapticSurface surface = SurfaceOf(*volume);
      fresh->cache = CellCache{};
      const HapticOutput a = StepRenderer(surface, settings, hip, kTickS, *lasting);
      const HapticOutput b = StepRenderer(surface, settings, hip, kTickS, *fresh);
      ASSERT_EQ(a.proxy.p_DH_mm, b.proxy.p_DH_mm) << seed << ' ' << n;
      ASSERT_EQ(a.force_D_n, b.force_D_n) << seed << ' ' << n;
      ASSERT_EQ(a.proxy.moves, b.proxy.moves) << seed << ' ' << n;
      ASSERT_EQ(a.proxy.mode, b.proxy.mode) << seed << ' ' << n;
      if (a.proxy.mode == ProxyMode::kFree || a.proxy.mode == ProxyMode::kConstrained) {
        ASSERT_LE(a.proxy.density, 0.5) << seed << ' ' << n;
        // Of the voxels themselves, found anew.
        double density = 0.0;
        PlaceAt(surface, a.proxy.p_DH_mm, fresh->cache, density);
        ASSERT_LE(density, 0.5 + 1e-9) << seed << ' ' << n;
      }
      contacts += a.proxy.mode == ProxyMode::kConstrained;
      ejecting += a.proxy.mode == ProxyMode::kEjecting;
    }
  }
  EXPECT_GT(contacts, 250 * static_cast<long>(kSeeds));
  EXPECT_GT(ejecting, 5 * static_cast<long>(kSeeds));
}

TEST(EditedVolume, AnEditElsewhereIsNotFelt) {
  const HapticSettings settings{
      .stiffness_n_per_mm = 0.5, .static_friction = 0.4, .dynamic_friction = 0.3};
  Editor editor(7);
  auto edited = Ball();
  const auto still = Ball();
  auto a = std::make_unique<RendererState>(), b = std::make_unique<RendererState>();
  for (int n = 0; n < 3000; ++n) {
    // Contact on the side of high x, edits in the bricks of low x.
    if (n % 3 == 0) {
      Vec3i low = editor.Corner();
      low.x() %= 9;
      edited = editor.Edit(*edited, low);
    }
    const double t = n * 2e-3;
    const Vec3 hip = kCentre + Vec3(10.0 - 2.0 * std::cos(t), 3.0 * std::sin(3.0 * t), 2.0);
    const HapticOutput with = StepRenderer(SurfaceOf(*edited), settings, hip, kTickS, *a);
    const HapticOutput without = StepRenderer(SurfaceOf(*still), settings, hip, kTickS, *b);
    ASSERT_EQ(with.proxy.p_DH_mm, without.proxy.p_DH_mm) << n;
    ASSERT_EQ(with.force_D_n, without.force_D_n) << n;
    ASSERT_EQ(with.proxy.mode, without.proxy.mode) << n;
  }
}

TEST(EditedVolume, ACellKnowsWhenItMayHaveChanged) {
  const auto first = Ball();
  Brick brick = first->bricks().At({1, 2, 3})->Floats();
  brick[0] = 0.25f;
  const std::vector<BrickChange> changes = {{Vec3i(1, 2, 3), Leaf::Of(LeafType::kFloat, brick)}};
  const VolumeSnapshot second(first->metadata(), first->bricks().With(changes, 9), 9, 1);
  const auto touches = [](int v, int low) { return v >= low - 1 && v < low + 8; };
  for (int i = -1; i < kEdge; ++i) {
    for (int j = -1; j < kEdge; ++j) {
      for (int k = -1; k < kEdge; ++k) {
        const bool touched = touches(i, 8) && touches(j, 16) && touches(k, 24);
        ASSERT_EQ(second.CellRevision({i, j, k}), touched ? 9u : 1u) << i << ' ' << j << ' ' << k;
      }
    }
  }
  EXPECT_EQ(second.CellRevision({-2, 0, 0}), 0u);
  EXPECT_EQ(second.CellRevision({0, kEdge, 0}), 0u);
}

}  // namespace
}  // namespace palpate
