// The proxy on exact geometry. proxy_torture_test.cpp attacks it.
#include "server/haptics/proxy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/made_volume.h"

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

// Held by cells inside and outside: the ways out must not be taken for one that leads in.
TEST(Proxy, EntersTheVolumeFromAnyPointOfItsBorder) {
  const auto volume = MakeVolume(Vec3i(4, 4, 4), [](int i, int j, int k) {
    return i + j + k == 0 ? 1.0 : 0.0;  // nothing is in the way
  });
  const HapticSurface surface =
      MakeHapticSurface(*volume, Scaled(1.0), 1.0, DecompositionMethod::kTpbcc, 1);
  CellCache cache;
  for (int x = -1; x <= 4; ++x) {
    for (int y = -1; y <= 4; ++y) {
      for (int z = -1; z <= 4; ++z) {
        const Vec3 start(x, y, z), middle(1.6, 1.7, 1.4);
        Proxy proxy;
        StepProxy(surface, start, kFarMm, proxy, cache);
        const Vec3 hip = start + 0.1 * (middle - start);
        const ProxyStep step = StepProxy(surface, hip, kFarMm, proxy, cache);
        EXPECT_NEAR((step.p_DH_mm - hip).norm(), 0.0, 1e-12) << start.transpose();
      }
    }
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
    // It stays above the HIP, but for the facets' edges.
    ASSERT_GT((step.p_DH_mm - centre).normalized().dot((hip - centre).normalized()), 0.99);
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
