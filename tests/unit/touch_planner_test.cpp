// What the simulated hand touches: points all over the surface, and plans that hold, both with
// bounded work.
#include "server/simulated_hand/touch_planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "server/felt/registration.h"
#include "server/simulated_hand/simulated_device.h"
#include "server/simulated_hand/touch_points.h"
#include "server/simulated_hand/touch_strokes.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using VolumePtr = std::shared_ptr<const VolumeSnapshot>;

constexpr double kStiffness = 0.5;  // N/mm

HapticSurface Fitted(const VolumeSnapshot& volume, double isovalue,
                     FreeSide free_side = FreeSide::kBelow,
                     std::optional<double> scale = std::nullopt) {
  const VolumePlace registration = FitToWorkspace(volume.metadata(), SimulatedDeviceSpec(), scale);
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

const VolumeSnapshot& Ball() {
  static const VolumePtr ball = Cube(BallAt);
  return *ball;
}

// --- Free places

TEST(FreePlaces, AreOutsideOfTheLatticeWhereTheHandCanReachThat) {
  const HapticSurface surface = Fitted(Ball(), 0.5);
  const std::vector<Vec3> places_mm = FindFreePlaces(surface, SimulatedDeviceSpec());
  ASSERT_FALSE(places_mm.empty());
  for (const Vec3& p_mm : places_mm) {
    const Vec3 p_I = surface.X_ID.Apply(p_mm);
    EXPECT_TRUE((p_I.array() < -1.0).any() || (p_I.array() > 64.0).any()) << p_mm.transpose();
    EXPECT_TRUE(IsWithinReach(SimulatedDeviceSpec(), p_mm));
  }
}

// The lattice covers the workspace.
TEST(FreePlaces, AreOffTheSurfaceWithinTheLattice) {
  constexpr double kScale = 4.0, kRadiusMm = 20.0 * kScale, kOffMm = 2.0;
  const HapticSurface below = Fitted(Ball(), 0.5, FreeSide::kBelow, kScale);
  const std::vector<Vec3> around_mm = FindFreePlaces(below, SimulatedDeviceSpec());
  ASSERT_FALSE(around_mm.empty());
  const Vec3 center_mm = below.X_DI.Apply(Vec3::Constant(32.0));
  for (const Vec3& p_mm : around_mm) EXPECT_GT((p_mm - center_mm).norm(), kRadiusMm + kOffMm);
  const HapticSurface above = Fitted(Ball(), 0.5, FreeSide::kAbove, kScale);
  const std::vector<Vec3> within_mm = FindFreePlaces(above, SimulatedDeviceSpec());
  ASSERT_FALSE(within_mm.empty());
  for (const Vec3& p_mm : within_mm) EXPECT_LT((p_mm - center_mm).norm(), kRadiusMm - kOffMm);
  // All that the hand reaches is material.
  EXPECT_TRUE(
      FindFreePlaces(Fitted(Ball(), 0.5, FreeSide::kBelow, 40.0), SimulatedDeviceSpec()).empty());
}

// --- Points

// Each on the surface, its normal towards free space, within reach.
std::vector<SurfacePoint> ExpectGood(const HapticSurface& surface) {
  GuideCost cost;
  const DeviceDescription device = SimulatedDeviceSpec();
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
  const HapticSurface surface = Fitted(Ball(), 0.5);
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
  const HapticSurface surface = Fitted(Ball(), 0.5, FreeSide::kAbove);
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
  GuideCost cost;
  EXPECT_TRUE(FindTouchPoints(Fitted(Ball(), 1.0), SimulatedDeviceSpec(), {}, cost).empty());
  EXPECT_TRUE(PlanTouches(Fitted(Ball(), 1.0), SimulatedDeviceSpec(), kStiffness).strokes.empty());
  // Nor where the volume lies beyond the workspace.
  HapticSurface away = Fitted(Ball(), 0.5);
  away.X_DI.translation += Vec3(500.0, 0.0, 0.0);
  away = MakeHapticSurface(Ball(), away.X_DI, 0.5, DecompositionMethod::kTpbcc, 2);
  GuideCost none;
  EXPECT_TRUE(FindTouchPoints(away, SimulatedDeviceSpec(), {}, none).empty());
  EXPECT_EQ(none.places, 0);
}

// 512³ voxels that take no memory: few leaves, which stand at many places.
VolumePtr Big(const std::function<LeafPtr(const Vec3i&)>& leaf) {
  return testing::VolumeOfLeaves(Vec3i::Constant(512), leaf);
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

// --- Plans

// The hand's points are in the material, not deep, and no leap apart; the ways between strokes
// are free but for their ends.
void ExpectSound(const TouchPlan& plan, const HapticSurface& surface) {
  SurfaceProbe probe(surface);
  const Vec3 bias_mm = Vec3::Constant(0.5 * SimulatedDeviceSpec().position_resolution_mm);
  const double most_mm = PressDepthMm(kStiffness);
  for (std::size_t s = 0; s < plan.strokes.size(); ++s) {
    const TouchStroke& stroke = plan.strokes[s];
    ASSERT_FALSE(stroke.points.empty());
    EXPECT_GT(stroke.least_s, 1.0);
    for (std::size_t n = 0; n < stroke.points.size(); ++n) {
      const TouchPoint& point = stroke.points[n];
      EXPECT_NEAR(probe.At(point.p_D_mm), 0.0, 0.02);
      EXPECT_TRUE(probe.IsMaterial(point.p_DHand_mm - bias_mm));
      EXPECT_LT((point.p_DHand_mm - point.p_D_mm).norm(), 1.5 * most_mm);
      EXPECT_GT(point.speed_mm_s, 5.0);
      EXPECT_LE(point.speed_mm_s, 60.0);
      if (n == 0) continue;
      EXPECT_LT((point.p_DHand_mm - stroke.points[n - 1].p_DHand_mm).norm(), 1.0);
    }
    if (s + 1 == plan.strokes.size()) break;
    const TouchPoint& from = stroke.points.back();
    const TouchPoint& to = plan.strokes[s + 1].points.front();
    const TouchArc arc(from.p_DHand_mm, from.normal_D, to.p_DHand_mm, to.normal_D,
                       stroke.lift_to_next_mm);
    EXPECT_FALSE(probe.IsMaterial(arc.At(0.5)));
  }
}

TEST(TouchPlanner, StrokesOverABall) {
  const HapticSurface surface = Fitted(Ball(), 0.5);
  const TouchPlan plan = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  ExpectSound(plan, surface);
  EXPECT_GE(plan.strokes.size(), 8u);
  for (const TouchStroke& stroke : plan.strokes) EXPECT_GT(LengthMm(stroke), 8.0);
}

TEST(TouchPlanner, StrokesAlongATubeInItsMiddle) {
  const VolumePtr tube = Cube(TubeAt);
  const HapticSurface surface = Fitted(*tube, 0.5);
  const TouchPlan plan = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  ExpectSound(plan, surface);
  ASSERT_FALSE(plan.strokes.empty());
  const TouchStroke& stroke = plan.strokes.front();
  EXPECT_GT(LengthMm(stroke), 20.0);
  for (const TouchPoint& point : stroke.points) {
    const Vec3 p_I = surface.X_ID.Apply(point.p_DHand_mm);
    EXPECT_LT((p_I - Vec3(32.5, 32.5, p_I.z())).norm(), 0.6);
  }
}

TEST(TouchPlanner, PressesAsTheStiffnessAllows) {
  EXPECT_NEAR(PressDepthMm(0.5), 1.2, 1e-9);
  EXPECT_NEAR(PressDepthMm(1.0), 0.6, 1e-9);
  EXPECT_NEAR(PressDepthMm(3.0), 0.25, 1e-9);
  EXPECT_NEAR(PressDepthMm(0.0), 1.5, 1e-9);
}

TEST(TouchPlanner, KeepsToTheWorkspaceOfAMagnifiedVolume) {
  const HapticSurface surface = Fitted(Ball(), 0.5, FreeSide::kBelow, 2.5);
  const TouchPlan plan = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  ASSERT_FALSE(plan.strokes.empty());
  for (const TouchStroke& stroke : plan.strokes) {
    for (const TouchPoint& point : stroke.points) {
      EXPECT_TRUE(IsWithinReach(SimulatedDeviceSpec(), point.p_D_mm));
    }
  }
}

TEST(TouchPlanner, TheSameSurfaceGivesTheSameBits) {
  const HapticSurface surface = Fitted(Ball(), 0.5);
  const TouchPlan one = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  const TouchPlan other = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  ASSERT_EQ(one.strokes.size(), other.strokes.size());
  for (std::size_t s = 0; s < one.strokes.size(); ++s) {
    ASSERT_EQ(one.strokes[s].points.size(), other.strokes[s].points.size());
    for (std::size_t n = 0; n < one.strokes[s].points.size(); ++n) {
      EXPECT_EQ(one.strokes[s].points[n].p_DHand_mm, other.strokes[s].points[n].p_DHand_mm);
    }
  }
}

// Work and memory, as counts: of a gyroid of 512³ voxels, a leaf of which stands everywhere.
TEST(TouchPlanner, IsBoundedOnABigVolume) {
  Brick brick{};
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) {
      for (int k = 0; k < 8; ++k) {
        const double x = i * M_PI / 4.0, y = j * M_PI / 4.0, z = k * M_PI / 4.0;
        brick[VoxelInBrick(i, j, k)] =
            static_cast<float>(0.5 + 0.2 * (std::sin(x) * std::cos(y) + std::sin(y) * std::cos(z) +
                                            std::sin(z) * std::cos(x)));
      }
    }
  }
  const LeafPtr leaf = Leaf::Of(LeafType::kFloat, brick);
  const VolumePtr volume = Big([&](const Vec3i&) { return leaf; });
  const GuideBudget budget;
  GuideCost cost;
  const TouchPlan plan =
      PlanTouches(Fitted(*volume, 0.5), SimulatedDeviceSpec(), kStiffness, budget, &cost);
  EXPECT_FALSE(plan.strokes.empty());
  EXPECT_LE(plan.strokes.size(), static_cast<std::size_t>(budget.strokes));
  std::size_t bytes = 0;
  for (const TouchStroke& stroke : plan.strokes) {
    bytes += stroke.points.capacity() * sizeof(TouchPoint);
  }
  EXPECT_LT(bytes, std::size_t{2} << 20);
  // The last stroke or way may go over.
  EXPECT_LT(cost.reads, budget.reads * 5 / 4);
  EXPECT_LE(cost.places, budget.places);
}

}  // namespace
}  // namespace palpate
