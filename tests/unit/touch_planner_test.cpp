// Plans for the simulated hand: what can be touched as planned, with bounded work.
#include "server/guide/touch_planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "server/device/simulated_device.h"
#include "server/guide/surface_probe.h"
#include "server/guide/touch_strokes.h"
#include "server/scene/registration.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr double kStiffness = 0.5;  // N/mm

HapticSurface Fitted(const VolumeSnapshot& volume, double isovalue,
                     std::optional<double> scale = std::nullopt) {
  const Registration registration = FitToWorkspace(volume.metadata(), SimulatedDeviceSpec(), scale);
  return MakeHapticSurface(volume, registration.X_DW * volume.metadata().WorldFromIndex(), isovalue,
                           DecompositionMethod::kTpbcc, 1);
}

std::shared_ptr<const VolumeSnapshot> Ball() {
  return testing::MakeVolume(Vec3i::Constant(64), [](int i, int j, int k) {
    return std::clamp(0.5 - (Vec3(i - 32, j - 32, k - 32).norm() - 20.0) / 8.0, 0.0, 1.0);
  });
}

std::shared_ptr<const VolumeSnapshot> Tube() {
  return testing::MakeVolume(Vec3i::Constant(64), [](int i, int j, int) {
    return i / 2 == 16 && j / 2 == 16 ? 1.0 : 0.0;
  });
}

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
  const auto ball = Ball();
  const HapticSurface surface = Fitted(*ball, 0.5);
  const TouchPlan plan = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  ExpectSound(plan, surface);
  EXPECT_GE(plan.strokes.size(), 8u);
  for (const TouchStroke& stroke : plan.strokes) EXPECT_GT(LengthMm(stroke), 8.0);
}

TEST(TouchPlanner, StrokesAlongATubeInItsMiddle) {
  const auto tube = Tube();
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

TEST(TouchPlanner, IsEmptyWithoutASurface) {
  const auto ball = Ball();
  EXPECT_TRUE(PlanTouches(Fitted(*ball, 1.0), SimulatedDeviceSpec(), kStiffness).strokes.empty());
}

TEST(TouchPlanner, KeepsToTheWorkspaceOfAMagnifiedVolume) {
  const auto ball = Ball();
  const HapticSurface surface = Fitted(*ball, 0.5, 2.5);
  const TouchPlan plan = PlanTouches(surface, SimulatedDeviceSpec(), kStiffness);
  ASSERT_FALSE(plan.strokes.empty());
  for (const TouchStroke& stroke : plan.strokes) {
    for (const TouchPoint& point : stroke.points) {
      EXPECT_TRUE(IsWithinReach(SimulatedDeviceSpec(), point.p_D_mm));
    }
  }
}

TEST(TouchPlanner, TheSameSurfaceGivesTheSameBits) {
  const auto ball = Ball();
  const HapticSurface surface = Fitted(*ball, 0.5);
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
  VolumeMetadata metadata;
  metadata.size = Vec3i::Constant(512);
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
  const VolumeSnapshot volume(
      metadata, BrickDirectory(metadata.size, [&](const Vec3i&) { return leaf; }), 1, 1);
  const GuideBudget budget;
  GuideCost cost;
  const TouchPlan plan =
      PlanTouches(Fitted(volume, 0.5), SimulatedDeviceSpec(), kStiffness, budget, &cost);
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
