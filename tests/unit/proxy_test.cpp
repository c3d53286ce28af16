// The proxy on exact geometry, and single moves of it. proxy_torture_test.cpp attacks it.
#include "server/haptics/proxy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <utility>

#include "server/haptics/moves.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using testing::MakeVolume;

constexpr double kFarMm = 1e9;  // an eject limit that never bites

// A proxy, and what it is on.
struct Prober {
  Prober(std::shared_ptr<const VolumeSnapshot> volume, double isovalue,
         const AffineMap& X_DI = AffineMap(),
         DecompositionMethod method = DecompositionMethod::kTpbcc)
      : held(std::move(volume)), surface(MakeHapticSurface(*held, X_DI, isovalue, method, 1)) {}

  ProxyStep Step(const Vec3& hip_mm, double eject_limit_mm = kFarMm) {
    return StepProxy(surface, hip_mm, eject_limit_mm, proxy, cache);
  }

  std::shared_ptr<const VolumeSnapshot> held;
  HapticSurface surface;
  Proxy proxy;
  CellCache cache;
};

// Plane z = 4.3: density rises along -z, so that free space is above.
std::shared_ptr<const VolumeSnapshot> PlaneVolume() {
  return MakeVolume(Vec3i(9, 9, 9), [](int, int, int k) { return (8.0 - k) / 8.0; });
}
Prober OnPlane(double mm_per_voxel = 1.0) {
  return Prober(PlaneVolume(), (8.0 - 4.3) / 8.0, {Mat3::Identity() * mm_per_voxel, Vec3::Zero()});
}

TEST(Proxy, OnAPlaneItIsTheClosestPoint) {
  for (double mm : {0.01, 1.0, 10.0}) {
    Prober prober = OnPlane(mm);
    prober.Step(mm * Vec3(4.2, 4.1, 6.0));
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> inside(1.0, 7.0);
    for (int n = 0; n < 1000; ++n) {
      const Vec3 hip(inside(random), inside(random), 2.0);
      const ProxyStep step = prober.Step(mm * hip);
      ASSERT_EQ(step.mode, ProxyMode::kConstrained);
      ASSERT_FALSE(step.capped);
      ASSERT_NEAR((step.p_DH_mm / mm - Vec3(hip.x(), hip.y(), 4.3)).norm(), 0.0, 1e-5);
      ASSERT_NEAR((step.normal_D - Vec3(0, 0, 1)).norm(), 0.0, 1e-5);
    }
  }
}

// A recording may have any revision.
TEST(Proxy, NoRevisionOfTheGeometryIsSpecial) {
  for (const std::uint64_t revision : {std::uint64_t{0}, ~std::uint64_t{0}}) {
    Prober prober = OnPlane();
    prober.surface.geometry_revision = revision;
    prober.Step(Vec3(4.2, 4.1, 6.0));
    EXPECT_NEAR(prober.Step(Vec3(4.2, 4.1, 2.0)).p_DH_mm.z(), 4.3, 1e-5) << revision;
  }
}

TEST(Proxy, InFreeSpaceItIsTheHip) {
  Prober prober = OnPlane();
  for (const Vec3& hip : {Vec3(4, 4, 6), Vec3(100, 3, 7), Vec3(100, 3, -50), Vec3(-80, 4, 60),
                          Vec3(4, 4, 7), Vec3(4, 4, 9), Vec3(4, 4, 8), Vec3(0, 0, 8)}) {
    const ProxyStep step = prober.Step(hip);
    EXPECT_EQ(step.mode, ProxyMode::kFree) << hip.transpose();
    EXPECT_NEAR((step.p_DH_mm - hip).norm(), 0.0, 1e-12);
    EXPECT_TRUE(step.normal_D.isZero());
  }
}

// Held by cells inside and outside: the ways out must not be taken for one that leads in.
TEST(Proxy, EntersTheVolumeFromAnyPointOfItsBorder) {
  Prober prober(MakeVolume(Vec3i(4, 4, 4),
                           [](int i, int j, int k) {
                             return i + j + k == 0 ? 1.0 : 0.0;  // nothing is in the way
                           }),
                1.0);
  for (int x = -1; x <= 4; ++x) {
    for (int y = -1; y <= 4; ++y) {
      for (int z = -1; z <= 4; ++z) {
        const Vec3 start(x, y, z), middle(1.6, 1.7, 1.4);
        prober.proxy = Proxy();
        prober.Step(start);
        const Vec3 hip = start + 0.1 * (middle - start);
        EXPECT_NEAR((prober.Step(hip).p_DH_mm - hip).norm(), 0.0, 1e-12) << start.transpose();
      }
    }
  }
}

TEST(Proxy, TheBorderOfTheVolumeIsACap) {
  // Solid throughout: felt from outside half a layer off the lattice.
  // Range 0.9..1: τ between; the plane x = 0 is free, x >= 1 solid.
  Prober prober(MakeVolume(Vec3i(6, 6, 6), [](int i, int, int) { return i == 0 ? 0.9 : 1.0; }),
                0.5);
  prober.Step(Vec3(3, 3, 20));
  const ProxyStep step = prober.Step(Vec3(3, 3, 3));
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
  Prober prober(volume, volume->Normalize(0.5));
  prober.Step(Vec3(8.0, 4.0, 14.0));
  prober.Step(Vec3(8.0, 4.0, 9.0));
  const ProxyStep step = prober.Step(Vec3(9.0, 4.0, 8.0));
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
  Prober prober(volume, 0.5);
  const Vec3 hip = centre + Vec3(5.0, 1.0, 2.0);
  prober.Step(centre + Vec3(15, 3, 6));
  for (int n = 0; n < 400; ++n) {
    prober.surface.isovalue = 0.5 + 0.15 * std::sin(n * 0.1);
    const ProxyStep step = prober.Step(hip);
    ASSERT_LE(step.density, prober.surface.isovalue);
    ASSERT_NE(step.mode, ProxyMode::kFree);
    ASSERT_NEAR((step.p_DH_mm - centre).norm(), radius(prober.surface.isovalue), 0.1);
    // It stays above the HIP, but for the facets' edges.
    ASSERT_GT((step.p_DH_mm - centre).normalized().dot((hip - centre).normalized()), 0.99);
  }
}

TEST(Proxy, IsBuriedWhereTheSurfaceIsFarAndComesFreeInFreeSpace) {
  const Vec3 deep(4, 4, 1), above(4, 4, 7);
  for (const int steps : {1, 60}) {
    Prober prober = OnPlane();
    for (int n = 0; n < steps; ++n) {
      const ProxyStep step = prober.Step(deep, 2.0);
      ASSERT_EQ(step.mode, ProxyMode::kInside) << n;
      ASSERT_EQ(step.p_DH_mm, deep);
      ASSERT_TRUE(step.normal_D.isZero());
    }
    EXPECT_EQ(prober.Step(above, 2.0).mode, ProxyMode::kFree);
    const ProxyStep step = prober.Step(deep, 2.0);
    EXPECT_EQ(step.mode, ProxyMode::kConstrained);
    EXPECT_NEAR(step.p_DH_mm.z(), 4.3, 1e-6);
  }
}

// The plane z = `height`, of a volume that was loaded later.
Prober& LoadPlane(double height, std::uint64_t revision, Prober& prober) {
  const auto value = [=](int, int, int k) { return (height + 3.7 - k) / 8.0; };
  prober.held = MakeVolume(Vec3i(9, 9, 9), value, revision);
  prober.surface = MakeHapticSurface(*prober.held, AffineMap(), prober.held->Normalize(3.7 / 8.0),
                                     DecompositionMethod::kTpbcc, revision);
  return prober;
}

TEST(Proxy, AnotherVolumeOverTheStylusDoesNotPush) {
  const Vec3 hip(4, 4, 4);
  Prober prober = OnPlane();
  prober.Step(Vec3(4, 4, 7));
  prober.Step(hip);  // on the surface, at 4.3
  // An edit may push it out by 2.4 mm, and a step of the lattice by less than a voxel.
  EXPECT_NEAR(LoadPlane(5.2, 2, prober).Step(hip, 6.6).p_DH_mm.z(), 5.2, 1e-6);
  ProxyStep step = LoadPlane(7.6, 3, prober).Step(hip, 6.6);
  EXPECT_EQ(step.mode, ProxyMode::kInside);
  EXPECT_TRUE(step.normal_D.isZero());
  EXPECT_EQ(prober.Step(hip, 6.6).mode, ProxyMode::kInside);
  // Forces begin when it is out.
  EXPECT_EQ(prober.Step(Vec3(4, 4, 7.8), 6.6).mode, ProxyMode::kFree);
  EXPECT_NEAR(prober.Step(hip, 6.6).p_DH_mm.z(), 7.6, 1e-6);
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
  Prober prober(volume, 0.5, X_DI);
  const Vec3 hip = X_DI.Apply(Vec3(6, 6, 6));
  const ProxyStep step = prober.Step(hip);
  EXPECT_EQ(step.mode, ProxyMode::kEjecting);
  EXPECT_LE(step.density, 0.5);
  EXPECT_LT((step.p_DH_mm - hip).norm(), 1.0);
}

TEST(Proxy, FollowsASphereWithEveryMethod) {
  const Vec3 centre = Vec3::Constant(15.5);
  const auto volume = MakeVolume(Vec3i::Constant(32), [&](int i, int j, int k) {
    return std::clamp(0.5 - ((Vec3(i, j, k) - centre).norm() - 11.0) / 8.0, 0.0, 1.0);
  });
  for (const auto method : {DecompositionMethod::kBcc, DecompositionMethod::kTpbcc}) {
    SCOPED_TRACE(NameOf(method));
    Prober prober(volume, volume->Normalize(0.5), AffineMap(), method);
    prober.Step(centre + Vec3(14, 0, 0));
    for (int n = 0; n < 5000; ++n) {
      const double angle = 0.002 * n;
      const Vec3 around(std::cos(angle), std::sin(angle), 0.3 * std::sin(7 * angle));
      const ProxyStep step = prober.Step(centre + 10.0 * around.normalized());
      ASSERT_LE(step.density, prober.surface.isovalue);
      ASSERT_NEAR((step.p_DH_mm - centre).norm(), 11.0, 0.06);
      ASSERT_EQ(step.mode, ProxyMode::kConstrained);
    }
  }
}

TEST(Proxy, WhereNothingIsFreeItIsBuried) {
  const auto volume = PlaneVolume();
  Prober prober(volume, 0.5);
  const auto step_above = [&](double isovalue) {
    prober.surface = MakeHapticSurface(*volume, AffineMap(), isovalue, DecompositionMethod::kTpbcc,
                                       1, FreeSide::kAbove);
    return prober.Step(Vec3(4.2, 4.1, 1.0), 2.0);
  };
  EXPECT_EQ(step_above(0.5).mode, ProxyMode::kFree);
  const ProxyStep step = step_above(1.0);
  EXPECT_EQ(step.mode, ProxyMode::kInside);
  EXPECT_TRUE(step.normal_D.isZero());
  EXPECT_TRUE(prober.proxy.buried);
}

// From a vertex of a crossed cell along the edge of a free one: what the move leaves as
// it is, is where the vertex lies, and nothing that the place was before.
// Where all vertices but one are nearly equal, the least weight of that one moves H a long way. A
// point on H whose weight there is dropped as rounding is put back on H.
TEST(MoveInTetrahedron, KeepsAPointOnHThatLosesAVertex) {
  const auto volume = MakeVolume(Vec3i::Constant(4), [](int i, int j, int k) {
    return i == 1 && j == 1 && k == 1 ? 1.0 : 0.0;
  });
  Prober prober(volume, 0.0);
  HapticCell& cell = prober.cache.Decomposed(prober.surface, Vec3i(1, 1, 1));
  int moved = 0;
  for (int t = 0; t < cell.parts.complex.tetrahedron_count; ++t) {
    const auto& v = cell.parts.complex.vertices[t];
    Candidate candidate{.kind = Candidate::Kind::kTetrahedron,
                        .cell = cell.cell,
                        .entry = &cell,
                        .carrier = {4, v, {0.3, 0.3, 0.3, 0.3}},
                        .tetrahedron = t,
                        .along_surface = true};
    int dense = 0;
    for (int n = 0; n < 4; ++n) {
      if (!(cell.parts.density[v[n]] > 0.01)) continue;
      candidate.carrier.weight[n] = 3e-12;
      ++dense;
    }
    if (dense != 1) continue;
    for (double& weight : candidate.carrier.weight) weight /= 0.9 + 3e-12;
    prober.surface.isovalue = DensityAt(cell, candidate.carrier);
    Place place;
    Contact contact = Contact::kUpper;
    MoveInTetrahedron(prober.surface, candidate, Contact::kNone, place, contact, prober.cache);
    EXPECT_EQ(place.carrier.count, 3);
    EXPECT_LE(DensityAt(cell, place.carrier), prober.surface.isovalue);
    EXPECT_NEAR(DensityAt(cell, place.carrier), prober.surface.isovalue, 1e-20);
    ++moved;
  }
  EXPECT_GT(moved, 3);
}

TEST(MoveInBox, BeginsWhereTheSimplexIs) {
  Prober prober(MakeVolume({8, 8, 8}, [](int i, int j, int k) { return i + 0.1 * j + 0.01 * k; }),
                0.5);
  Place place;
  place.kind = Place::Kind::kSimplex;
  place.cell = Vec3i(2, 3, 3);
  place.p_L = Vec3(0.25, 7.5, -30.0);  // of no simplex
  place.carrier.count = 1;
  place.carrier.vertex[0] = static_cast<std::uint8_t>(CornerAt(1, 0, 1));
  place.carrier.weight[0] = 1.0;
  place.faces = FacesOf(place.carrier);
  Candidate candidate;
  candidate.kind = Candidate::Kind::kBox;
  candidate.cell = Vec3i(3, 3, 4);
  candidate.entry = &prober.cache.Densities(prober.surface, candidate.cell);
  candidate.faces = 0x15;
  candidate.d_mm = Vec3(0.0, 0.5, 0.0);
  MoveInBox(prober.surface, candidate, place, prober.cache);
  EXPECT_EQ(place.kind, Place::Kind::kBox);
  EXPECT_EQ(place.p_L, Vec3(3.0, 3.5, 4.0));
  EXPECT_EQ(place.faces, 0x11);
}

// A free cell of the voxels is one box, however fine the lattice is.
TEST(MoveInBox, CrossesAFreeVoxelInOneMove) {
  Prober prober(MakeVolume({40, 40, 8}, [](int, int, int k) { return k; }), 1.0 / 7.0);
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> along(1.0, 38.0), height(-1.0, 0.9);
  std::array<int, 3> moves{};
  for (int n = 0; n < 200; ++n) {
    const Vec3 from(along(random), along(random), height(random));
    const Vec3 to(along(random), along(random), height(random));
    for (const int refinement : {1, 2, 4}) {
      prober.surface.Refine(refinement);
      prober.proxy = Proxy();
      prober.Step(from);
      const ProxyStep step = prober.Step(to);
      moves[refinement / 2] += step.moves;
      ASSERT_NEAR((step.p_DH_mm - to).norm(), 0.0, 1e-9);
    }
  }
  EXPECT_EQ(moves[1], moves[0]);
  EXPECT_EQ(moves[2], moves[0]);
}

// All tetrahedra would be more than a cell has, and all faces more than a cone has room for.
TEST(Place, WithoutVerticesIsInNoTetrahedronAndOnNoFace) {
  Prober prober(MakeVolume({4, 4, 4}, [](int i, int, int) { return i; }), 0.5);
  const HapticCell& cell = prober.cache.Decomposed(prober.surface, Vec3i(1, 1, 1));
  EXPECT_EQ(TetrahedraAt(cell.parts.complex, Carrier()), 0u);
  EXPECT_EQ(FacesOf(Carrier()), 0u);
}

}  // namespace
}  // namespace palpate
