// Sides, friction, viscosity, pops, magnet and shading: on exact geometry.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "server/haptics/effects.h"
#include "server/haptics/renderer.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr double kDtS = 1e-3;
constexpr int kBallEdge = 32;
const Vec3 kBallCentre = Vec3::Constant((kBallEdge - 1) / 2.0);
constexpr double kBallRadius = 11.0;

// Voxels of 1 mm; the index frame is the device's.
class Effects : public ::testing::Test {
 protected:
  void Use(std::shared_ptr<const VolumeSnapshot> volume, double isovalue) {
    volume_ = std::move(volume);
    isovalue_ = volume_->Normalize(isovalue);
    state_ = std::make_unique<RendererState>();
  }
  // Solid below z = 4.3.
  void UsePlane() {
    Use(testing::MakeVolume(Vec3i(17, 17, 9), [](int, int, int k) { return (8.0 - k) / 8.0; }),
        (8.0 - 4.3) / 8.0);
  }
  // Solid from z = 4.5 to z = 8.5.
  void UsePlate() {
    Use(testing::MakeVolume(Vec3i(9, 9, 14),
                            [](int, int, int k) { return k >= 5 && k <= 8 ? 1.0 : 0.0; }),
        0.5);
  }
  void PopIntoPlate() {
    UsePlate();
    settings_.pop_force_n = 0.5;
    Step(Vec3(4.2, 4.1, 11));
    for (int n = 0; n < 100; ++n) Step(Vec3(4.2, 4.1, 7.0));
    EXPECT_EQ(state_->passed, 1);
  }
  void UseSphere() {
    Use(testing::MakeVolume(Vec3i::Constant(kBallEdge),
                            [](int i, int j, int k) {
                              return 0.5 -
                                     ((Vec3(i, j, k) - kBallCentre).norm() - kBallRadius) / 8.0;
                            }),
        0.5);
  }
  HapticSurface Surface() const {
    return MakeHapticSurface(*volume_, AffineMap{}, isovalue_, DecompositionMethod::kTpbcc, 1,
                             settings_.free_side);
  }
  HapticOutput Step(const Vec3& hip) {
    return StepRenderer(Surface(), settings_, hip, kDtS, *state_);
  }

  std::shared_ptr<const VolumeSnapshot> volume_;
  double isovalue_ = 0.5;
  HapticSettings settings_{.stiffness_n_per_mm = 1.0};
  std::unique_ptr<RendererState> state_;
};

TEST_F(Effects, ASphereIsFeltFromTheInside) {
  UseSphere();
  settings_.free_side = FreeSide::kAbove;
  EXPECT_TRUE(Step(kBallCentre).force_D_n.isZero());
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  Vec3 direction(1, 0, 0);
  for (int n = 0; n < 5000; ++n) {
    direction =
        (direction + 0.03 * Vec3(normal(random), normal(random), normal(random))).normalized();
    const HapticOutput output = Step(kBallCentre + 13.0 * direction);
    ASSERT_EQ(output.proxy.mode, ProxyMode::kConstrained);
    ASSERT_GE(output.proxy.density, isovalue_);
    ASSERT_NEAR((output.proxy.p_DH_mm - kBallCentre).norm(), kBallRadius, 0.06);
    ASSERT_LT(output.force_D_n.dot(direction), -1.8);
    const VisualProxy visual = VisualProxyOf(Surface(), output, *state_);
    ASSERT_TRUE(visual.found);
    ASSERT_LT(visual.normal_D.dot(direction), -0.9);
  }
}

TEST_F(Effects, BothSidesFeelTheSameSurface) {
  UseSphere();
  const HapticSurface below = Surface(), above = below.Flipped();
  CellCache one, other;
  int crossed = 0;
  for (int x = 0; x < kBallEdge; ++x) {
    const Vec3i index(x, 15, 12);
    HapticCell& a = one.Densities(below, index);
    if (!a.IsCrossed(below)) continue;
    ++crossed;
    one.Decomposed(below, index);
    const HapticCell& b = other.Decomposed(above, index);
    for (int v = 0; v < kMaxVertices; ++v) {
      if (!(a.parts.complex.used_vertices >> v & 1)) continue;
      ASSERT_EQ(a.parts.position[v], b.parts.position[v]);
      ASSERT_EQ(a.parts.density[v], -b.parts.density[v]);
    }
  }
  EXPECT_GT(crossed, 1);
}

TEST_F(Effects, BeyondTheVolumeTheInsideIsOutOfReach) {
  UseSphere();
  settings_.free_side = FreeSide::kAbove;
  for (const Vec3& hip : {Vec3(-50, 3, 3), Vec3(0, 0, 0), Vec3(1e5, 0, 0)}) {
    const HapticOutput output = Step(hip);
    EXPECT_EQ(output.proxy.mode, ProxyMode::kInside);
    EXPECT_TRUE(output.force_D_n.isZero());
  }
  EXPECT_EQ(Step(kBallCentre).proxy.mode, ProxyMode::kFree);
}

TEST_F(Effects, FrictionHoldsUpToTheStaticConeAndDragsAtTheDynamicOne) {
  UsePlane();
  settings_.static_friction = 0.5;
  settings_.dynamic_friction = 0.2;
  const double depth = 2.0;
  Step(Vec3(4, 8, 6));
  const Vec3 start = Step(Vec3(4, 8, 4.3 - depth)).proxy.p_DH_mm;
  bool slid = false;
  for (int n = 1; n <= 300; ++n) {
    const double x = 4.0 + 0.01 * n;
    const HapticOutput output = Step(Vec3(x, 8, 4.3 - depth));
    const double lag = x - output.proxy.p_DH_mm.x();
    ASSERT_NEAR(output.proxy.p_DH_mm.z(), 4.3, 1e-5);
    ASSERT_NEAR(output.force_D_n.z(), depth, 1e-5);
    ASSERT_NEAR(output.force_D_n.x(), -lag, 1e-5);
    if (x - 4.0 < 0.5 * depth - 0.02) {
      ASSERT_NEAR((output.proxy.p_DH_mm - start).norm(), 0.0, 1e-6) << n;
    }
    if (x - 4.0 > 0.5 * depth + 0.02) {
      slid = true;
      ASSERT_NEAR(lag, 0.2 * depth, 1e-4) << n;
    }
  }
  EXPECT_TRUE(slid);
}

TEST_F(Effects, FrictionNeverExceedsItsConeOnACurvedSurface) {
  UseSphere();
  settings_.static_friction = settings_.dynamic_friction = 0.3;
  // The cone is drawn at the HIP, which is nearer to the centre than the surface is:
  // a way of 0.3 depths there is R / (R - depth) times that on H. And the proxy may
  // rest on this or that side of an edge of H, whose facets meet at 0.1 rad (below).
  const double depth = 1.5;
  const double bound = std::tan(std::atan(0.3 * kBallRadius / (kBallRadius - depth) * 1.01) + 0.1);
  Step(kBallCentre + Vec3(14, 0, 0));
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  Vec3 direction(1, 0, 0);
  double greatest = 0.0;
  for (int n = 0; n < 5000; ++n) {
    direction =
        (direction + 0.01 * Vec3(normal(random), normal(random), normal(random))).normalized();
    const HapticOutput output = Step(kBallCentre + (kBallRadius - depth) * direction);
    ASSERT_LE(output.proxy.density, isovalue_);
    const double along = output.force_D_n.dot(output.proxy.normal_D);
    const double across = (output.force_D_n - along * output.proxy.normal_D).norm();
    ASSERT_GT(along, 0.0);
    greatest = std::max(greatest, across / along);
    ASSERT_LT(across / along, bound);
  }
  EXPECT_GT(greatest, 0.25);
}

// Thin things, where the way around is short: friction holds, and adds no force.
TEST_F(Effects, FrictionOnASmallBallAddsNothingToTheSpring) {
  Use(testing::MakeVolume(Vec3i::Constant(13),
                          [](int i, int j, int k) {
                            return 0.5 - ((Vec3(i, j, k) - Vec3::Constant(6)).norm() - 3.0) / 8.0;
                          }),
      0.5);
  settings_ = {.stiffness_n_per_mm = 1.0, .static_friction = 2.0, .dynamic_friction = 1.0};
  Step(Vec3(6, 6, 12));
  std::mt19937_64 random(6);
  std::normal_distribution<double> normal;
  Vec3 hip(6, 6, 9);
  long contacts = 0;
  for (int n = 0; n < 20'000; ++n) {
    hip += 0.1 * Vec3(normal(random), normal(random), normal(random));
    hip = Vec3::Constant(6) +
          (hip - Vec3::Constant(6)) * std::min(1.0, 4.0 / (hip - Vec3::Constant(6)).norm());
    const HapticOutput output = Step(hip);
    if (output.proxy.normal_D.isZero(0.0)) continue;
    ++contacts;
    ASSERT_NEAR((output.force_D_n - output.spring_D_n).norm(), 0.0, 1e-9);
    ASSERT_GE(output.spring_D_n.dot(output.proxy.normal_D), -1e-9);
  }
  EXPECT_GT(contacts, 5000);
}

TEST_F(Effects, FrictionHoldsOnASurfaceThatMoves) {
  UsePlane();
  settings_.static_friction = settings_.dynamic_friction = 0.5;
  Step(Vec3(4, 8, 6));
  Step(Vec3(4, 8, 2.3));
  Step(Vec3(4.8, 8, 2.3));
  const double x = state_->proxy.p_DH_mm.x();
  EXPECT_NEAR(x, 4.0, 1e-6);
  const double isovalue = isovalue_;
  for (int n = 0; n < 500; ++n) {
    // Sinks and rises by 0.4 mm.
    isovalue_ = isovalue + 0.05 * std::sin(n * 0.02);
    const HapticOutput output = Step(Vec3(4.8, 8, 2.3));
    ASSERT_NEAR(output.force_D_n.x(), -0.8, 1e-3) << n;
    ASSERT_NEAR(output.proxy.p_DH_mm.z(), 4.3 - 8.0 * (isovalue_ - isovalue), 1e-3) << n;
  }
}

TEST_F(Effects, ViscosityDragsInFreeSpaceAndKnowsHowLongNoPositionCame) {
  UsePlane();
  settings_.viscosity_n_s_per_m = 2.0;
  HapticOutput output;
  for (int n = 0; n < 200; ++n) output = Step(Vec3(4 + 0.02 * n, 8, 7));  // 20 mm/s
  EXPECT_NEAR((output.force_D_n - Vec3(-0.04, 0, 0)).norm(), 0.0, 1e-6);
  for (int n = 0; n < 499; ++n) Step(Vec3(std::nan(""), 8, 7));
  EXPECT_LT(Step(Vec3(17.98, 8, 7)).force_D_n.norm(), 2.0 * 0.02 * 1.01);  // 10 mm in 0.5 s
}

TEST_F(Effects, PopsThroughAPlateAboveTheSetForceOnly) {
  UsePlate();
  settings_.pop_force_n = 1.0;
  // From above: the near side at 8.5, the far one at 4.5.
  Step(Vec3(4.2, 4.1, 11));
  int pops = 0;
  Vec3 last_n = Vec3::Zero();
  for (int n = 0; n < 9000; ++n) {
    const double z = 11.0 - 0.001 * n;
    const HapticOutput output = Step(Vec3(4.2, 4.1, z));
    pops += output.popped;
    if (z > 8.5 - 0.99) {
      ASSERT_EQ(pops, 0) << z;
    }
    if (z < 8.5 - 1.01 && z > 4.5 - 0.99) {
      ASSERT_EQ(pops, 1) << z;
    }
    // Within the plate it is held by the far side, from within.
    const double sign = output.free_side == FreeSide::kAbove ? -1.0 : 1.0;
    ASSERT_LE(sign * output.proxy.density, sign * isovalue_);
    ASSERT_LE(output.spring_D_n.norm(), 1.0 + 1e-6);
    // 1 N over kPopFadeS, and the spring's own 0.001 N.
    ASSERT_LT((output.force_D_n - last_n).norm(), 1.0 * kDtS / kPopFadeS + 0.002) << z;
    last_n = output.force_D_n;
  }
  EXPECT_EQ(pops, 2);
  EXPECT_FALSE(state_->proxy.on_surface());
}

TEST_F(Effects, APopIsSmoothWithEverythingOn) {
  UsePlate();
  settings_ = {.stiffness_n_per_mm = 2.0,
               .damping_n_s_per_m = 5.0,
               .pop_force_n = 1.5,
               .passivity_control = true};
  Step(Vec3(4.2, 4.1, 11));
  int pops = 0;
  Vec3 last_n = Vec3::Zero();
  for (int n = 0; n < 900; ++n) {
    const HapticOutput output = Step(Vec3(4.2, 4.1, 11.0 - 0.01 * n));  // 10 mm/s
    TellWrittenForce(output.force_D_n, *state_);
    pops += output.popped;
    ASSERT_LT((output.force_D_n - last_n).norm(), 0.2) << n;
    last_n = output.force_D_n;
  }
  EXPECT_EQ(pops, 2);
}

TEST_F(Effects, ANewVolumeIsMetFromTheSideOfTheStylus) {
  PopIntoPlate();
  // The plate is a mm farther down now, and the stylus above it.
  const auto lower = testing::MakeVolume(
      Vec3i(9, 9, 14), [](int, int, int k) { return k >= 1 && k <= 4 ? 1.0 : 0.0; });
  const HapticSurface surface =
      MakeHapticSurface(*lower, AffineMap{}, lower->Normalize(0.5), DecompositionMethod::kTpbcc, 2);
  HapticOutput output;
  for (int n = 0; n < 40; ++n) {
    output = StepRenderer(surface, settings_, Vec3(4.2, 4.1, 7.0), kDtS, *state_);
  }
  EXPECT_EQ(output.free_side, FreeSide::kBelow);
  EXPECT_EQ(output.proxy.mode, ProxyMode::kFree);
  EXPECT_NEAR(output.force_D_n.norm(), 0.0, 1e-9);
}

TEST_F(Effects, TurningPopsOffBringsTheProxyBack) {
  PopIntoPlate();
  settings_.pop_force_n = 0.0;
  HapticOutput output = Step(Vec3(4.2, 4.1, 7.0));
  EXPECT_EQ(output.proxy.mode, ProxyMode::kEjecting);
  output = Step(Vec3(4.2, 4.1, 7.0));
  EXPECT_LE(output.proxy.density, isovalue_);
  EXPECT_EQ(output.free_side, FreeSide::kBelow);
}

TEST_F(Effects, WithPopsNoPositionIsBuried) {
  UsePlate();
  settings_.pop_force_n = 3.0;
  settings_.stiffness_n_per_mm = 3.0;
  const HapticOutput output = Step(Vec3(4.2, 4.1, 6.5));
  EXPECT_NE(output.proxy.mode, ProxyMode::kInside);
  EXPECT_FALSE(state_->proxy.buried);
}

TEST_F(Effects, TheNearestPointIsNoFartherThanAnyOtherOfTheSurface) {
  // Noise: many sheets. The proxy gives points of H to compare with.
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform;
  Use(testing::MakeVolume(Vec3i::Constant(12), [&](int, int, int) { return uniform(random); }),
      0.7);
  const HapticSurface surface = Surface();
  CellCache cache;
  int compared = 0;
  for (int n = 0; n < 300; ++n) {
    const Vec3 p = 1.0 + 9.0 * Eigen::Array3d(uniform(random), uniform(random), uniform(random));
    const auto nearest = NearestPointOnSurface(surface, p, 3.0, cache);
    const double distance = nearest ? (*nearest - p).norm() : 3.0;
    for (int ray = 0; ray < 20; ++ray) {
      Proxy proxy;
      const ProxyStep start = StepProxy(surface, p, 1e9, proxy, cache);
      if (start.mode != ProxyMode::kFree) break;
      const Vec3 towards(uniform(random) - 0.5, uniform(random) - 0.5, uniform(random) - 0.5);
      const ProxyStep step = StepProxy(surface, p + 4.0 * towards, 1e9, proxy, cache);
      if (step.mode != ProxyMode::kConstrained) continue;
      ++compared;
      ASSERT_LE(distance, (step.p_DH_mm - p).norm() + 1e-9);
    }
  }
  EXPECT_GT(compared, 500);
  EXPECT_FALSE(NearestPointOnSurface(surface, Vec3(5, 5, 20), 2.5, cache));
  EXPECT_FALSE(NearestPointOnSurface(surface, Vec3(1e7, 0, 0), 2.5, cache));
}

TEST_F(Effects, TheMagnetPullsWithinItsRangeAndNotOnTheSurface) {
  UsePlane();
  settings_.magnet_force_n = 0.8;
  settings_.magnet_range_mm = 2.0;
  const auto pull = [&](double height) { return Step(Vec3(8, 8, 4.3 + height)).force_D_n; };
  EXPECT_TRUE(pull(2.5).isZero());
  EXPECT_NEAR((pull(1.0) - Vec3(0, 0, -0.8)).norm(), 0.0, 1e-5);
  EXPECT_NEAR((pull(1.5) - Vec3(0, 0, -0.6)).norm(), 0.0, 1e-5);
  EXPECT_LT(pull(0.001).norm(), 0.002);
  EXPECT_NEAR((pull(-0.5) - Vec3(0, 0, 0.5)).norm(), 0.0, 1e-5);
}

TEST_F(Effects, TheMagnetIsContinuousWhateverTheVoxels) {
  UsePlane();
  settings_.magnet_force_n = 1.5;
  for (const double mm : {0.05, 0.25, 1.0}) {
    const HapticSurface surface = MakeHapticSurface(*volume_, {Mat3::Identity() * mm, Vec3::Zero()},
                                                    isovalue_, DecompositionMethod::kTpbcc, 1);
    RendererState state;
    Vec3 last = Vec3::Zero();
    double greatest = 0.0;
    for (int n = 0; n < 4000; ++n) {
      const Vec3 hip = mm * Vec3(8.1, 8.2, 12.3 - 8.0 * n / 4000.0);
      const Vec3 force = StepRenderer(surface, settings_, hip, kDtS, state).force_D_n;
      greatest = std::max(greatest, force.norm());
      // The steepest slope is 4 forces a range, which is 4 voxels or 2 mm.
      const double slope = 4.0 * 1.5 / std::min(2.0, 4.0 * mm);
      ASSERT_LT((force - last).norm(), 1.1 * slope * mm * 8.0 / 4000.0) << mm << " " << n;
      last = force;
    }
    EXPECT_NEAR(greatest, 1.5, 0.01) << mm;
  }
}

TEST_F(Effects, AShadedNormalIsExactOnAPlaneAndNeverLeansFar) {
  UsePlane();
  const HapticSurface surface = Surface();
  EXPECT_NEAR((ShadedNormal(surface, Vec3(8.2, 8.1, 4.3), Vec3(0, 0, 1)) - Vec3(0, 0, 1)).norm(),
              0.0, 1e-6);
  const Vec3 far = ShadedNormal(surface, Vec3(8.2, 8.1, 4.3), Vec3(1, 0, 0));
  EXPECT_NEAR(std::acos(far.x()), kMaxShadingAngleRad, 1e-6);
  EXPECT_GT(far.z(), 0.0);
}

TEST_F(Effects, ShadingSmoothsTheForceAndKeepsItsMagnitude) {
  UseSphere();
  const auto largest_turn = [&](bool shading) {
    settings_.force_shading = shading;
    state_ = std::make_unique<RendererState>();
    Step(kBallCentre + Vec3(14, 0, 0));
    double largest = 0.0;
    Vec3 last = Vec3::Zero();
    for (int n = 0; n < 4000; ++n) {
      const double angle = 0.0005 * n;
      const HapticOutput output =
          Step(kBallCentre + 10.0 * Vec3(std::cos(angle), std::sin(angle), 0));
      EXPECT_NEAR(output.force_D_n.norm(), output.spring_D_n.norm(), 1e-9);
      const Vec3 direction = output.force_D_n.normalized();
      if (n > 0) largest = std::max(largest, std::acos(std::min(1.0, direction.dot(last))));
      last = direction;
    }
    return largest;
  };
  const double flat = largest_turn(false), shaded = largest_turn(true);
  // At an edge of H the proxy, 1 mm off the HIP, jumps by `flat` mm: on a sphere of
  // kBallRadius mm that turns the true normal by flat / kBallRadius.
  EXPECT_LT(shaded, 1.1 * flat / kBallRadius + 0.001);
}

// Everything at once, with τ, sides and settings that change while the stylus is
// thrown about.
TEST_F(Effects, NoMixOfThemFallsThroughOrIsNotFinite) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform;
  long contacts = 0, pops = 0, steps = 0;
  for (int grid = 0; grid < 60; ++grid) {
    const int levels = grid % 3 == 0 ? 4 : 1000;
    Use(testing::MakeVolume(Vec3i::Constant(6),
                            [&](int, int, int) { return std::floor(uniform(random) * levels); }),
        0.0);
    isovalue_ = uniform(random);
    Vec3 hip = Vec3::Constant(-2.0);
    for (int n = 0; n < 2000; ++n, ++steps) {
      if (uniform(random) < 0.01) isovalue_ = uniform(random);
      if (uniform(random) < 0.005) {
        settings_.free_side = uniform(random) < 0.5 ? FreeSide::kBelow : FreeSide::kAbove;
        settings_.static_friction = uniform(random) < 0.5 ? 0.0 : uniform(random);
        settings_.dynamic_friction = uniform(random) < 0.5 ? 0.0 : uniform(random);
        settings_.pop_force_n = uniform(random) < 0.5 ? 0.0 : uniform(random);
        settings_.magnet_force_n = uniform(random) < 0.5 ? 0.0 : uniform(random);
        settings_.force_shading = uniform(random) < 0.5;
        settings_.passivity_control = uniform(random) < 0.5;
        settings_.viscosity_n_s_per_m = uniform(random);
        settings_.damping_n_s_per_m = uniform(random);
      }
      const Vec3 r(uniform(random), uniform(random), uniform(random));
      hip = uniform(random) < 0.02 ? Vec3(10.0 * r - Vec3::Constant(2.0))
                                   : Vec3(hip + 0.3 * (r - Vec3::Constant(0.5)));
      const HapticOutput output = Step(hip);
      ASSERT_TRUE(output.force_D_n.allFinite());
      ASSERT_TRUE(output.proxy.p_DH_mm.allFinite());
      pops += output.popped;
      contacts += output.proxy.mode == ProxyMode::kConstrained;
      if (output.proxy.mode != ProxyMode::kFree && output.proxy.mode != ProxyMode::kConstrained) {
        continue;
      }
      const double sign = output.free_side == FreeSide::kAbove ? -1.0 : 1.0;
      if (state_->proxy.place.kind == Place::Kind::kOutside) continue;
      ASSERT_LE(sign * output.proxy.density, sign * isovalue_);
    }
  }
  EXPECT_GT(contacts, steps / 10);
  EXPECT_GT(pops, 100);
}

}  // namespace
}  // namespace palpate
