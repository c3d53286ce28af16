// The proxy: on exact geometry, and under random attack.
#include "server/haptics/proxy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "server/haptics/moves.h"
#include "tests/support/array_volume.h"

namespace palpate {
namespace {

using testing::MakeVolume;

constexpr double kFarMm = 1e9;  // an eject limit that never bites

AffineMap Scaled(double mm_per_voxel) { return {Mat3::Identity() * mm_per_voxel, Vec3::Zero()}; }

// Plane z = 4.3: density rises along -z, so that free space is above.
std::shared_ptr<const VolumeSnapshot> PlaneVolume() {
  return MakeVolume(Vec3i(9, 9, 9), [](int, int, int k) { return (8.0 - k) / 8.0; });
}

double PlaneIsovalue(const VolumeSnapshot& volume) { return volume.Normalize((8.0 - 4.3) / 8.0); }

TEST(Proxy, OnAPlaneItIsTheClosestPoint) {
  const auto volume = PlaneVolume();
  for (double mm : {0.01, 1.0, 10.0}) {
    const HapticSurface surface = MakeHapticSurface(*volume, Scaled(mm), PlaneIsovalue(*volume),
                                                    DecompositionMethod::kTpbcc, 1);
    Proxy proxy;
    CellCache cache;
    StepProxy(surface, mm * Vec3(4.2, 4.1, 6.0), kFarMm, proxy, cache);
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> inside(1.0, 7.0);
    for (int n = 0; n < 1000; ++n) {
      const Vec3 hip(inside(random), inside(random), 2.0);
      const ProxyStep step = StepProxy(surface, mm * hip, kFarMm, proxy, cache);
      ASSERT_EQ(step.mode, ProxyMode::kConstrained);
      ASSERT_FALSE(step.capped);
      ASSERT_NEAR((step.p_DH_mm / mm - Vec3(hip.x(), hip.y(), 4.3)).norm(), 0.0, 1e-5);
      ASSERT_NEAR((step.normal_D - Vec3(0, 0, 1)).norm(), 0.0, 1e-5);
    }
  }
}

TEST(Proxy, InFreeSpaceItIsTheHip) {
  const auto volume = PlaneVolume();
  const HapticSurface surface = MakeHapticSurface(*volume, Scaled(1.0), PlaneIsovalue(*volume),
                                                  DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  for (const Vec3& hip : {Vec3(4, 4, 6), Vec3(100, 3, 7), Vec3(100, 3, -50), Vec3(-80, 4, 60),
                          Vec3(4, 4, 7), Vec3(4, 4, 9), Vec3(4, 4, 8), Vec3(0, 0, 8)}) {
    const ProxyStep step = StepProxy(surface, hip, kFarMm, proxy, cache);
    EXPECT_EQ(step.mode, ProxyMode::kFree) << hip.transpose();
    EXPECT_NEAR((step.p_DH_mm - hip).norm(), 0.0, 1e-12);
    EXPECT_TRUE(step.normal_D.isZero());
  }
}

TEST(Proxy, TheBorderOfTheVolumeIsACap) {
  // Solid throughout: felt from outside half a layer off the lattice.
  const auto volume =
      MakeVolume(Vec3i(6, 6, 6), [](int i, int, int) { return i == 0 ? 0.9 : 1.0; });
  // Range 0.9..1: τ between; the plane x = 0 is free, x >= 1 solid.
  const HapticSurface surface =
      MakeHapticSurface(*volume, Scaled(1.0), 0.5, DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  StepProxy(surface, Vec3(3, 3, 20), kFarMm, proxy, cache);
  const ProxyStep step = StepProxy(surface, Vec3(3, 3, 3), kFarMm, proxy, cache);
  EXPECT_EQ(step.mode, ProxyMode::kConstrained);
  EXPECT_GT(step.p_DH_mm.z(), 5.0);
  EXPECT_LT(step.p_DH_mm.z(), 6.0);
}

TEST(Proxy, OnASphereItLiesBelowTheHipOnTheSurface) {
  constexpr int kEdge = 40;
  const Vec3 centre = Vec3::Constant((kEdge - 1) / 2.0);
  const double radius = 14.0;
  const auto volume = MakeVolume(Vec3i::Constant(kEdge), [&](int i, int j, int k) {
    return std::clamp(0.5 - ((Vec3(i, j, k) - centre).norm() - radius) / 8.0, 0.0, 1.0);
  });
  const HapticSurface surface = MakeHapticSurface(*volume, Scaled(0.5), volume->Normalize(0.5),
                                                  DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  StepProxy(surface, 0.5 * (centre + Vec3(18, 0, 0)), kFarMm, proxy, cache);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  Vec3 direction(1, 0, 0);
  for (int n = 0; n < 20000; ++n) {
    direction =
        (direction + 0.02 * Vec3(normal(random), normal(random), normal(random))).normalized();
    const Vec3 hip = centre + 12.0 * direction;
    const ProxyStep step = StepProxy(surface, 0.5 * hip, kFarMm, proxy, cache);
    ASSERT_EQ(step.mode, ProxyMode::kConstrained);
    ASSERT_LE(step.density, surface.isovalue);
    const Vec3 p = step.p_DH_mm / 0.5 - centre;
    // Chords of cells of edge 1 on radius 14 sag by up to 3 / (8 · 14) = 0.027.
    ASSERT_NEAR(p.norm(), radius, 0.03);
    ASSERT_LT(RestResidual(surface, 0.5 * hip, proxy, cache), 1e-6);
  }
}

TEST(Proxy, SlidesOffAConvexEdge) {
  // A roof with its ridge along y: pulled down beside the ridge, the proxy must
  // not stay on it.
  const auto volume = MakeVolume(Vec3i(17, 9, 17), [](int i, int, int k) {
    return std::clamp(0.5 - (k - 10.0 + 0.5 * std::abs(i - 8.0)) / 16.0, 0.0, 1.0);
  });
  const HapticSurface surface = MakeHapticSurface(*volume, Scaled(1.0), volume->Normalize(0.5),
                                                  DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  StepProxy(surface, Vec3(8.0, 4.0, 14.0), kFarMm, proxy, cache);
  StepProxy(surface, Vec3(8.0, 4.0, 9.0), kFarMm, proxy, cache);
  const ProxyStep step = StepProxy(surface, Vec3(9.0, 4.0, 8.0), kFarMm, proxy, cache);
  // Foot of the perpendicular from (9, 8) on z = 10 - (x - 8) / 2.
  EXPECT_NEAR(step.p_DH_mm.x(), 9.6, 0.02);
  EXPECT_NEAR(step.p_DH_mm.z(), 9.2, 0.02);
}

TEST(Proxy, IsCarriedWithTheSurface) {
  constexpr int kEdge = 32;
  const Vec3 centre = Vec3::Constant((kEdge - 1) / 2.0);
  const auto volume = MakeVolume(Vec3i::Constant(kEdge), [&](int i, int j, int k) {
    return std::clamp(1.0 - (Vec3(i, j, k) - centre).norm() / 16.0, 0.0, 1.0);
  });
  const auto radius = [&](double isovalue) { return 16.0 * (1.0 - volume->Denormalize(isovalue)); };
  Proxy proxy;
  CellCache cache;
  HapticSurface surface =
      MakeHapticSurface(*volume, Scaled(1.0), 0.5, DecompositionMethod::kTpbcc, 1);
  const Vec3 hip = centre + Vec3(5.0, 1.0, 2.0);
  StepProxy(surface, centre + Vec3(15, 3, 6), kFarMm, proxy, cache);
  for (int n = 0; n < 400; ++n) {
    surface.isovalue = 0.5 + 0.15 * std::sin(n * 0.1);
    const ProxyStep step = StepProxy(surface, hip, kFarMm, proxy, cache);
    ASSERT_LE(step.density, surface.isovalue);
    ASSERT_NE(step.mode, ProxyMode::kFree);
    ASSERT_NEAR((step.p_DH_mm - centre).norm(), radius(surface.isovalue), 0.1);
  }
}

TEST(Proxy, IsBuriedWhereTheSurfaceIsFarAndComesFreeInFreeSpace) {
  const auto volume = PlaneVolume();
  const HapticSurface surface = MakeHapticSurface(*volume, Scaled(1.0), PlaneIsovalue(*volume),
                                                  DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  const Vec3 deep(4, 4, 1);
  ProxyStep step = StepProxy(surface, deep, 2.0, proxy, cache);
  EXPECT_EQ(step.mode, ProxyMode::kEjecting);
  EXPECT_EQ(step.p_DH_mm, deep);
  step = StepProxy(surface, Vec3(4, 4, 7), 2.0, proxy, cache);
  EXPECT_EQ(step.mode, ProxyMode::kFree);
  step = StepProxy(surface, deep, 2.0, proxy, cache);
  EXPECT_EQ(step.mode, ProxyMode::kConstrained);
  EXPECT_NEAR(step.p_DH_mm.z(), 4.3, 1e-6);
}

TEST(Proxy, BuriedForLongIsAFaultThatEndsInFreeSpace) {
  const auto volume = PlaneVolume();
  const HapticSurface surface = MakeHapticSurface(*volume, Scaled(1.0), PlaneIsovalue(*volume),
                                                  DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  for (int n = 0; n < 60; ++n) {
    const ProxyStep step = StepProxy(surface, Vec3(4, 4, 1), 2.0, proxy, cache);
    ASSERT_EQ(step.mode, n < kMaxEjectSteps ? ProxyMode::kEjecting : ProxyMode::kFault) << n;
    ASSERT_TRUE(step.normal_D.isZero());
  }
  EXPECT_EQ(StepProxy(surface, Vec3(4, 4, 7), 2.0, proxy, cache).mode, ProxyMode::kFree);
}

TEST(Proxy, IsEjectedToTheVertexNearestInMillimetres) {
  // A pit of free voxels on each side of a solid; voxels 10 mm wide, 0.1 mm thin:
  // the pit five voxels up is nearer than the one beside.
  const auto volume = MakeVolume(Vec3i(13, 13, 13), [](int i, int j, int k) {
    const bool pit = (i == 8 && j == 6 && k == 6) || (i == 6 && j == 6 && k == 11);
    return pit ? 0.0 : (i == 6 && j == 6 && k == 6) ? 0.8 : 1.0;
  });
  AffineMap X_DI;
  X_DI.linear = Vec3(10.0, 10.0, 0.1).asDiagonal();
  const HapticSurface surface =
      MakeHapticSurface(*volume, X_DI, 0.5, DecompositionMethod::kTpbcc, 1);
  Proxy proxy;
  CellCache cache;
  const Vec3 hip = X_DI.Apply(Vec3(6, 6, 6));
  const ProxyStep step = StepProxy(surface, hip, kFarMm, proxy, cache);
  EXPECT_EQ(step.mode, ProxyMode::kEjecting);
  EXPECT_LE(step.density, surface.isovalue);
  EXPECT_LT((step.p_DH_mm - hip).norm(), 1.0);
}

// The methods for comparison: no promise, but they are felt all the same.
TEST(Proxy, FollowsASphereWithEveryMethod) {
  const Vec3 centre = Vec3::Constant(15.5);
  const auto volume = MakeVolume(Vec3i::Constant(32), [&](int i, int j, int k) {
    return std::clamp(0.5 - ((Vec3(i, j, k) - centre).norm() - 11.0) / 8.0, 0.0, 1.0);
  });
  for (int m = 0; m < 4; ++m) {
    const HapticSurface surface = MakeHapticSurface(*volume, Scaled(1.0), volume->Normalize(0.5),
                                                    static_cast<DecompositionMethod>(m), 1);
    Proxy proxy;
    CellCache cache;
    StepProxy(surface, centre + Vec3(14, 0, 0), kFarMm, proxy, cache);
    int contacts = 0;
    for (int n = 0; n < 5000; ++n) {
      const double angle = 0.002 * n;
      const Vec3 around(std::cos(angle), std::sin(angle), 0.3 * std::sin(7 * angle));
      const ProxyStep step =
          StepProxy(surface, centre + 10.0 * around.normalized(), kFarMm, proxy, cache);
      ASSERT_LE(step.density, surface.isovalue) << kMethodNames[m];
      ASSERT_NEAR((step.p_DH_mm - centre).norm(), 11.0, 0.06) << kMethodNames[m];
      contacts += step.mode == ProxyMode::kConstrained;
    }
    EXPECT_EQ(contacts, 5000) << kMethodNames[m];
  }
}

struct Torture {
  long moves = 0, steps = 0, fall_throughs = 0, unrested = 0, capped = 0, contacts = 0,
       misplaced = 0;
};

// Random values on 5³ lattices of `levels` values (0: continuous), and a HIP
// that drifts, jitters, teleports, and sits on lattice points.
void TortureGrid(std::mt19937_64& random, int levels, int steps, Torture& result) {
  std::uniform_real_distribution<double> uniform;
  const auto volume = MakeVolume(Vec3i::Constant(5), [&](int, int, int) {
    return levels == 0 ? uniform(random) : std::floor(uniform(random) * levels);
  });
  const double range = volume->metadata().value_max - volume->metadata().value_min;
  if (!(range > 0.0)) return;
  Mat3 shear = Mat3::Identity();
  if (uniform(random) < 0.5) {
    shear << 1.0, 0.3, 0.0, 0.0, -0.7, 0.1, 0.2, 0.0, 1.4;  // mirrored, sheared, uneven
  }
  const double mm = std::pow(10.0, 3.0 * uniform(random) - 2.0);
  const AffineMap X_DI{shear * mm, Vec3(3.0, -7.0, 11.0)};
  double isovalue = uniform(random);
  // Equal to a value that is there, the least and the greatest included.
  if (uniform(random) < 0.4) {
    isovalue = volume->StoredCell(Vec3i(1, 1, 1))[static_cast<std::size_t>(uniform(random) * 8)];
  }
  if (uniform(random) < 0.1) isovalue = uniform(random) < 0.5 ? 0.0 : 1.0;
  const FreeSide side = uniform(random) < 0.7 ? FreeSide::kBelow : FreeSide::kAbove;
  const HapticSurface surface =
      MakeHapticSurface(*volume, X_DI, isovalue, DecompositionMethod::kTpbcc, 1, side);
  static CellCache cache;
  cache = CellCache();
  Proxy proxy;
  Vec3 hip_I = Vec3::Constant(-3.0);
  StepProxy(surface, X_DI.Apply(hip_I), kFarMm, proxy, cache);
  for (int n = 0; n < steps; ++n) {
    const double kind = uniform(random);
    const Vec3 r(uniform(random), uniform(random), uniform(random));
    if (kind < 0.02) {
      hip_I = 10.0 * r - Vec3::Constant(3.0);
    } else if (kind < 0.05) {
      hip_I = hip_I.array().round();
    } else {
      hip_I += (kind < 0.5 ? 0.05 : 0.6) * (r - Vec3::Constant(0.5));
      hip_I = hip_I.cwiseMax(-2.0).cwiseMin(6.0);
    }
    const Vec3 hip = X_DI.Apply(hip_I);
    const ProxyStep step = StepProxy(surface, hip, kFarMm, proxy, cache);
    ++result.steps;
    result.moves += step.moves;
    result.capped += step.capped;
    result.contacts += step.mode == ProxyMode::kConstrained;
    // From above τ, the stylus is out of reach of the surface where it starts.
    if (proxy.buried) continue;
    const bool outside = proxy.place.kind == Place::Kind::kOutside;
    result.fall_throughs += !outside && surface.sign() * step.density > surface.isovalue;
    // Judged anew from the position alone.
    double density = 0.0;
    PlaceAt(surface, surface.X_ID.Apply(step.p_DH_mm), cache, density);
    result.misplaced += density > surface.isovalue + 1e-9;
    if (step.capped) continue;
    // The approach that is left, as a share of the way and in voxels: beyond the
    // tolerances of the proxy, the second 1e-11, by a margin.
    const double residual = RestResidual(surface, hip, proxy, cache);
    const double left_voxels = residual * (hip - step.p_DH_mm).norm() / surface.voxel_mm;
    result.unrested += residual > 1e-6 && left_voxels > 2e-11;
  }
}

TEST(ProxyTorture, NeverFallsThroughAndAlwaysRests) {
  // PALPATE_TORTURE=N multiplies the length.
  const char* factor = std::getenv("PALPATE_TORTURE");
  const int grids = 60 * (factor ? std::atoi(factor) : 1);
  std::mt19937_64 random(6);
  for (int levels : {0, 256, 16, 4, 2}) {
    Torture result;
    for (int n = 0; n < grids; ++n) TortureGrid(random, levels, 3000, result);
    std::printf(
        "levels %3d: %ld steps, %ld moves, %ld in contact, fall-throughs %ld, misplaced %ld, "
        "not at rest %ld, capped %ld\n",
        levels, result.steps, result.moves, result.contacts, result.fall_throughs, result.misplaced,
        result.unrested, result.capped);
    EXPECT_GT(result.contacts, result.steps / 20);
    EXPECT_EQ(result.fall_throughs, 0);
    EXPECT_EQ(result.misplaced, 0);
    EXPECT_EQ(result.unrested, 0);
    EXPECT_EQ(result.capped, 0);
  }
}

// τ and the side change under the proxy, again and again: it is moved out, or buried,
// and never left inside.
struct Ejections {
  long steps = 0, ejecting = 0, buried = 0, inside = 0;
};

void ChangeGrid(std::mt19937_64& random, int levels, int steps, Ejections& result) {
  std::uniform_real_distribution<double> uniform;
  const auto volume = MakeVolume(Vec3i::Constant(5), [&](int, int, int) {
    return levels == 0 ? uniform(random) : std::floor(uniform(random) * levels);
  });
  if (!(volume->metadata().value_max > volume->metadata().value_min)) return;
  static CellCache cache;
  cache = CellCache();
  Proxy proxy;
  Vec3 hip = Vec3::Constant(2.0);
  double isovalue = 0.5;
  FreeSide side = FreeSide::kBelow;
  for (int n = 0; n < steps; ++n) {
    if (uniform(random) < 0.2) isovalue = uniform(random);
    if (uniform(random) < 0.05) {
      isovalue = volume->StoredCell(Vec3i(1, 2, 1))[static_cast<std::size_t>(uniform(random) * 8)];
    }
    if (uniform(random) < 0.1) {
      side = side == FreeSide::kBelow ? FreeSide::kAbove : FreeSide::kBelow;
    }
    const Vec3 r(uniform(random), uniform(random), uniform(random));
    hip = uniform(random) < 0.05 ? Vec3(6.0 * r - Vec3::Ones())
                                 : Vec3(hip + 0.4 * (r - Vec3::Constant(0.5)));
    hip = hip.cwiseMax(-1.0).cwiseMin(5.0);
    const HapticSurface surface =
        MakeHapticSurface(*volume, Scaled(1.0), isovalue, DecompositionMethod::kTpbcc, 1, side);
    const ProxyStep step = StepProxy(surface, hip, 4.0, proxy, cache);
    ++result.steps;
    result.ejecting += step.mode == ProxyMode::kEjecting;
    result.buried += proxy.buried;
    if (proxy.buried) continue;
    double density = 0.0;
    PlaceAt(surface, surface.X_ID.Apply(step.p_DH_mm), cache, density);
    result.inside += density > surface.isovalue + 1e-9;
    result.inside += PlaceDensity(surface, proxy.place, cache) > surface.isovalue;
  }
}

TEST(ProxyTorture, ChangesOfIsovalueAndSideNeverLeaveItInside) {
  const char* factor = std::getenv("PALPATE_TORTURE");
  const int grids = 100 * (factor ? std::atoi(factor) : 1);
  std::mt19937_64 random(7);
  for (int levels : {2, 3, 4, 16, 0}) {
    Ejections result;
    for (int n = 0; n < grids; ++n) ChangeGrid(random, levels, 1000, result);
    std::printf("levels %2d: %ld steps, %ld ejecting, %ld buried, %ld inside\n", levels,
                result.steps, result.ejecting, result.buried, result.inside);
    EXPECT_GT(result.ejecting, result.steps / 100);
    EXPECT_EQ(result.inside, 0);
  }
}

TEST(Proxy, WhereNothingIsFreeItIsBuried) {
  const auto volume = PlaneVolume();
  Proxy proxy;
  CellCache cache;
  const auto step_above = [&](double isovalue) {
    const HapticSurface surface = MakeHapticSurface(
        *volume, Scaled(1.0), isovalue, DecompositionMethod::kTpbcc, 1, FreeSide::kAbove);
    return StepProxy(surface, Vec3(4.2, 4.1, 1.0), 2.0, proxy, cache);
  };
  EXPECT_EQ(step_above(0.5).mode, ProxyMode::kFree);
  const ProxyStep step = step_above(1.0);
  EXPECT_EQ(step.mode, ProxyMode::kEjecting);
  EXPECT_TRUE(step.normal_D.isZero());
  EXPECT_TRUE(proxy.buried);
}

}  // namespace
}  // namespace palpate
