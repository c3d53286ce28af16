// Points of the surface for the simulated hand: on it, all over it, and with bounded work.
#include "server/guide/touch_points.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include "server/device/simulated_device.h"
#include "server/guide/surface_probe.h"
#include "server/scene/registration.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using VolumePtr = std::shared_ptr<const VolumeSnapshot>;

HapticSurface Fitted(const VolumeSnapshot& volume, double isovalue,
                     FreeSide free_side = FreeSide::kBelow) {
  const Registration registration =
      FitToWorkspace(volume.metadata(), SimulatedDeviceSpec(), std::nullopt);
  return MakeHapticSurface(volume, registration.X_DW * volume.metadata().WorldFromIndex(), isovalue,
                           DecompositionMethod::kTpbcc, 1, free_side);
}

double BallAt(int i, int j, int k) {
  return std::clamp(0.5 - (Vec3(i - 32, j - 32, k - 32).norm() - 20.0) / 8.0, 0.0, 1.0);
}
double TubeAt(int i, int j, int) { return i / 2 == 16 && j / 2 == 16 ? 1.0 : 0.0; }
double ShellAt(int i, int j, int k) {
  return std::abs(Vec3(i - 32, j - 32, k - 32).norm() - 25.0) < 1.0 ? 1.0 : 0.0;
}
double DustAt(int i, int j, int k) { return (i + 5 * j + 11 * k) % 397 == 0 ? 1.0 : 0.0; }

VolumePtr Cube(const std::function<double(int, int, int)>& value) {
  return testing::MakeVolume(Vec3i::Constant(64), value);
}

// Each on the surface, its normal towards free space, within reach.
std::vector<SurfacePoint> ExpectGood(const HapticSurface& surface) {
  GuideCost cost;
  const DeviceSpec device = SimulatedDeviceSpec();
  const std::vector<SurfacePoint> points = FindTouchPoints(surface, device, {}, cost);
  SurfaceProbe probe(surface);
  for (const SurfacePoint& point : points) {
    EXPECT_NEAR(probe.At(point.p_D_mm), 0.0, 1e-9);
    EXPECT_NEAR(point.normal_D.norm(), 1.0, 1e-9);
    EXPECT_TRUE(IsWithinReach(device, point.p_D_mm));
    // Less dense that way than the other way.
    const Vec3 off = 0.3 * surface.voxel_mm * point.normal_D;
    EXPECT_LT(probe.At(point.p_D_mm + off), probe.At(point.p_D_mm - off));
  }
  return points;
}

TEST(TouchPoints, AreAllOverABall) {
  const VolumePtr ball = Cube(BallAt);
  const HapticSurface surface = Fitted(*ball, 0.5);
  const std::vector<SurfacePoint> points = ExpectGood(surface);
  EXPECT_GT(points.size(), 200u);
  int octants = 0;
  for (const SurfacePoint& point : points) {
    const Vec3 out_I = surface.X_ID.Apply(point.p_D_mm) - Vec3::Constant(32.0);
    EXPECT_NEAR(out_I.norm(), 20.0, 0.1);
    EXPECT_GT(out_I.normalized().dot(point.normal_D), 0.97);
    octants |= 1 << ((out_I.x() > 0) + 2 * (out_I.y() > 0) + 4 * (out_I.z() > 0));
  }
  EXPECT_EQ(octants, 0xff);
}

TEST(TouchPoints, OfTheOtherSideHaveTheOtherNormal) {
  const VolumePtr ball = Cube(BallAt);
  const HapticSurface surface = Fitted(*ball, 0.5, FreeSide::kAbove);
  const std::vector<SurfacePoint> points = ExpectGood(surface);
  EXPECT_GT(points.size(), 200u);
  int inwards = 0, near_border = 0;
  for (const SurfacePoint& point : points) {
    const Vec3 out_I = surface.X_ID.Apply(point.p_D_mm) - Vec3::Constant(32.0);
    near_border += out_I.cwiseAbs().maxCoeff() > 30.0;
    inwards += out_I.normalized().dot(point.normal_D) < -0.97;
  }
  EXPECT_EQ(near_border, 0);
  EXPECT_EQ(inwards, static_cast<int>(points.size()));
}

TEST(TouchPoints, FindThinThings) {
  for (const auto& value : {TubeAt, ShellAt, DustAt}) {
    const VolumePtr volume = Cube(value);
    for (const double isovalue : {0.2, 0.5, 0.8}) {
      EXPECT_GT(ExpectGood(Fitted(*volume, isovalue)).size(), 60u) << isovalue;
    }
  }
}

// The tube ends at the lattice's border: its two caps are surface.
TEST(TouchPoints, AreOnTheBorderOfTheLatticeToo) {
  const VolumePtr half = Cube([](int i, int, int) { return i < 32 ? 1.0 : 0.0; });
  const HapticSurface surface = Fitted(*half, 0.5);
  int sides = 0;
  for (const SurfacePoint& point : ExpectGood(surface)) {
    const Vec3 p_I = surface.X_ID.Apply(point.p_D_mm);
    for (int axis = 0; axis < 3; ++axis) {
      sides |= (p_I[axis] < 0.0) << (2 * axis);
      sides |= (p_I[axis] > (axis == 0 ? 31.0 : 63.0)) << (2 * axis + 1);
    }
  }
  EXPECT_EQ(sides, 0x3f);
}

TEST(TouchPoints, OfALevelSet) {
  const VolumePtr distances =
      Cube([](int i, int j, int k) { return Vec3(i - 32, j - 32, k - 32).norm() - 20.0; });
  VolumeMetadata metadata = distances->metadata();
  metadata.is_level_set = true;
  const VolumeSnapshot volume(metadata, distances->bricks(), 1, 1);
  const HapticSurface surface = Fitted(volume, volume.Normalize(0.0), FreeSide::kAbove);
  const std::vector<SurfacePoint> points = ExpectGood(surface);
  EXPECT_GT(points.size(), 200u);
  for (const SurfacePoint& point : points) {
    const Vec3 out_I = surface.X_ID.Apply(point.p_D_mm) - Vec3::Constant(32.0);
    EXPECT_GT(out_I.normalized().dot(point.normal_D), 0.97);
  }
}

TEST(TouchPoints, AreNoneWithoutASurface) {
  const VolumePtr ball = Cube(BallAt);
  GuideCost cost;
  EXPECT_TRUE(FindTouchPoints(Fitted(*ball, 1.0), SimulatedDeviceSpec(), {}, cost).empty());
  // Nor where the volume lies beyond the workspace.
  HapticSurface away = Fitted(*ball, 0.5);
  away.X_DI.translation += Vec3(500.0, 0.0, 0.0);
  away = MakeHapticSurface(*ball, away.X_DI, 0.5, DecompositionMethod::kTpbcc, 2);
  GuideCost none;
  EXPECT_TRUE(FindTouchPoints(away, SimulatedDeviceSpec(), {}, none).empty());
  EXPECT_EQ(none.places, 0);
}

TEST(TouchPoints, AreTheSameEveryTime) {
  const VolumePtr ball = Cube(BallAt);
  GuideCost cost;
  const auto one = FindTouchPoints(Fitted(*ball, 0.4), SimulatedDeviceSpec(), {}, cost);
  const auto other = FindTouchPoints(Fitted(*ball, 0.4), SimulatedDeviceSpec(), {}, cost);
  ASSERT_EQ(one.size(), other.size());
  for (std::size_t n = 0; n < one.size(); ++n) EXPECT_EQ(one[n].p_D_mm, other[n].p_D_mm);
}

// 512³ voxels that take no memory: few leaves, which stand at many places.
VolumePtr Big(const std::function<LeafPtr(const Vec3i&)>& leaf) {
  VolumeMetadata metadata;
  metadata.size = Vec3i::Constant(512);
  return std::make_shared<VolumeSnapshot>(metadata, BrickDirectory(metadata.size, leaf), 1, 1);
}

LeafPtr LeafWith(float value) {
  Brick brick{};
  brick[VoxelInBrick(3, 4, 5)] = value;
  return Leaf::Of(LeafType::kFloat, brick);
}

TEST(TouchPoints, OfABigVolumeAreFoundWithBoundedWork) {
  const GuideBudget budget;
  const LeafPtr below = LeafWith(0.2f), above = LeafWith(1.0f);
  const LeafPtr constant = Leaf::Constant(LeafType::kFloat, 0.0f);
  struct Case {
    const char* name;
    std::function<LeafPtr(const Vec3i&)> leaf;
    bool has_surface;
  };
  const Case cases[] = {
      {"surface everywhere", [&](const Vec3i&) { return above; }, true},
      {"noise below the isovalue", [&](const Vec3i&) { return below; }, false},
      {"sparse dust", [&](const Vec3i& b) { return b.sum() % 97 == 0 ? above : constant; }, true},
      {"dust in noise", [&](const Vec3i& b) { return b.sum() % 97 == 0 ? above : below; }, true},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.name);
    const VolumePtr volume = Big(one.leaf);
    GuideCost cost;
    const auto points = FindTouchPoints(Fitted(*volume, 0.5), SimulatedDeviceSpec(), budget, cost);
    EXPECT_EQ(points.size() > 100, one.has_surface);
    EXPECT_LE(points.size(), static_cast<std::size_t>(budget.points) + 16);
    EXPECT_LE(cost.places, budget.places);
    EXPECT_LE(cost.leaves, budget.leaves);
    EXPECT_LE(cost.reads, 8 * (budget.points + 16));
  }
}

}  // namespace
}  // namespace palpate
