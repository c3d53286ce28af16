// Rigid tools under random attack. Every chord of every ball is judged from positions alone.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <random>

#include "server/haptics/tool/chord.h"
#include "tests/support/scaled.h"
#include "tests/support/tick_rig.h"
#include "tests/support/tool_rig.h"
#include "tests/support/torture.h"

namespace palpate {
namespace {

using lab::ToolJudge;
using testing::Rod;
using testing::ToolRig;

struct Attack {
  long steps = 0, contacts = 0, falls = 0, judged = 0, capped = 0, ejections = 0, most_work = 0;
};

Eigen::Quaterniond RandomTurn(std::mt19937_64& random, double most_rad) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const Vec3 axis(normal(random), normal(random), normal(random));
  return testing::Turn(most_rad * uniform(random), axis);
}

// Balls up to two voxels from the grip, some at one place.
RigidTool RandomTool(std::mt19937_64& random, double voxel_mm) {
  std::uniform_real_distribution<double> uniform;
  constexpr int kCounts[] = {1, 2, 5, 16, 64};
  RigidTool tool = Rod(kCounts[static_cast<int>(uniform(random) * 5.0)], 2.0 * voxel_mm,
                       voxel_mm * std::pow(10.0, uniform(random)));
  if (uniform(random) < 0.5) {
    for (int n = 0; n < tool.count; ++n) {
      const Vec3 r(uniform(random), uniform(random), uniform(random));
      tool.ball[n].p_SBall_mm = voxel_mm * (3.0 * r - Vec3::Constant(1.5));
    }
  }
  return tool;
}

void AttackGrid(std::mt19937_64& random, const VolumeSnapshot& volume, int refinement, int steps,
                Attack& result) {
  if (!testing::HasRange(volume)) return;
  HapticSurface surface = testing::RandomSurface(random, volume, refinement);
  std::uniform_real_distribution<double> uniform;
  ToolRig rig(surface, RandomTool(random, surface.voxel_mm));
  ToolJudge judge(surface, rig.tool);
  Vec3 hip_I = Vec3::Constant(-3.0);
  ToolPose hand;
  for (int n = 0; n < steps; ++n) {
    testing::MoveHip(random, hip_I);
    hand.p_DS_mm = surface.X_DI.Apply(hip_I);
    hand.R_DS = RandomTurn(random, uniform(random) < 0.02 ? 3.14 : 0.1) * hand.R_DS;
    hand.R_DS.normalize();
    const ToolState before = rig.state;
    ToolPath path;
    const ToolStep step = rig.Step(hand, &path);
    ++result.steps;
    result.contacts += step.mode == ProxyMode::kConstrained;
    result.capped += step.capped;
    result.most_work = std::max<long>(result.most_work, step.work);
    if (before.placed && !before.buried) result.falls += judge.Falls(before.pose, path);
  }
  result.judged += judge.judged();
}

TEST(ToolTorture, NoBallEverCrossesH) {
  std::mt19937_64 random(3);
  for (const int levels : {0, 256, 16, 4, 2, 1}) {
    Attack result;
    for (int n = 0; n < std::max(6, test::Scaled(12)); ++n) {
      AttackGrid(random, *testing::RandomVolume(random, levels), n % 3 == 2 ? 2 : 1, 200, result);
    }
    std::printf(
        "levels %3d: %ld steps, %ld in contact, %ld of %ld points fell, %ld capped, work %ld\n",
        levels, result.steps, result.contacts, result.falls, result.judged, result.capped,
        result.most_work);
    EXPECT_GT(result.contacts, result.steps / 20);
    EXPECT_EQ(result.falls, 0);
    EXPECT_LE(result.most_work, kLeastToolWork);
    EXPECT_LT(result.capped, result.steps / 4);
  }
}

// Of the balls that were free at the beginning: also while others are brought out.
int FallsOfTheFree(const ToolRig& rig, const ToolPose& from, const ToolPath& path) {
  int falls = 0;
  for (int n = 0; n < rig.tool.count; ++n) {
    RigidTool ball = rig.tool;
    ball.count = 1;
    ball.ball[0] = rig.tool.ball[n];
    ToolJudge judge(rig.surface, ball);
    if (judge.Falls(from, from) == 0) falls += judge.Falls(from, path);
  }
  return falls;
}

// Where cells are many and slanted, too.
TEST(ToolTorture, NoStepWorksMoreThanItMay) {
  std::mt19937_64 random(12);
  std::uniform_real_distribution<double> uniform;
  Mat3 slanted;
  slanted << 1.0, 0.95, 0.9, 0.0, 0.3, 0.2, 0.0, 0.0, 0.3;
  long most = 0;
  for (int n = 0; n < std::max(6, test::Scaled(12)); ++n) {
    const auto checker = testing::MakeVolume(
        Vec3i::Constant(10), [](int i, int j, int k) { return (i + j + k) % 2 ? 1.0 : 0.0; });
    const HapticSurface surface =
        MakeHapticSurface(*checker, {slanted, Vec3::Zero()}, uniform(random),
                          DecompositionMethod::kTpbcc, 1, FreeSide::kBelow, 1 + n % 4);
    ToolRig rig(surface, RandomTool(random, surface.voxel_mm));
    ToolPose hand;
    for (int k = 0; k < 200; ++k) {
      const Vec3 hip_I = 12.0 * Vec3(uniform(random), uniform(random), uniform(random));
      if (k % 20 == 0) hand.p_DS_mm = surface.X_DI.Apply(hip_I - Vec3::Ones());
      hand.p_DS_mm += 0.05 * (hip_I - Vec3::Constant(6.0));
      hand.R_DS = RandomTurn(random, 0.1) * hand.R_DS;
      most = std::max<long>(most, rig.Step(hand).work);
    }
  }
  EXPECT_LE(most, kLeastToolWork);
}

// Rounding is coarse there: 1e-13 mm. A point on the faces of many tetrahedra is in one of them.
TEST(ToolTorture, FarFromTheOriginEveryPointHasADensity) {
  std::mt19937_64 random(13);
  std::uniform_real_distribution<double> uniform;
  const auto volume = testing::RandomVolume(random, 0);
  const auto cache = std::make_unique<ToolCellCache>();
  for (int n = 0; n < 20'000; ++n) {
    const Mat3 place = 0.01 * testing::Turn(uniform(random), Vec3(1, 2, 3)).toRotationMatrix();
    const HapticSurface surface = MakeHapticSurface(
        *volume, {place, 500.0 * Vec3(1.0, -1.0, 1.0)}, 0.0, DecompositionMethod::kTpbcc,
        static_cast<std::uint64_t>(n) + 1, FreeSide::kBelow, 1 + n % 3);
    const Vec3i corner(1 + n % 3, 1 + n / 3 % 3, 1 + n / 9 % 3);
    Surroundings around;
    int work = 0;
    Look(surface, surface.X_DI.Apply(corner.cast<double>()), 1e-5, *cache, around, work);
    ASSERT_TRUE(std::isfinite(around.excess)) << n;
    ASSERT_GE(around.excess, -1e-9);  // τ is the least value
  }
}

// A change of τ either leaves the tool free, or brings it out, or buries it.
TEST(ToolTorture, AfterAChangeOfTheIsovalueNoBallIsInside) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform;
  int steps = 0, ejected = 0, buried = 0, inside = 0, falls = 0;
  for (int n = 0; n < std::max(4, test::Scaled(20)); ++n) {
    const auto volume = testing::RandomVolume(random, 0);
    HapticSurface surface = testing::RandomSurface(random, *volume, 1);
    ToolRig rig(surface, RandomTool(random, surface.voxel_mm));
    rig.eject_limit_mm = 2.0 * surface.voxel_mm;
    Vec3 hip_I = Vec3::Constant(-3.0);
    ToolPose hand;
    for (int k = 0; k < 200; ++k) {
      testing::MoveHip(random, hip_I);
      hand.p_DS_mm = surface.X_DI.Apply(hip_I);
      // Below all values, the judge takes what is outside for the object, too.
      rig.surface.isovalue =
          std::clamp(rig.surface.isovalue + 0.02 * (uniform(random) - 0.5), 0.0, 1.0);
      const ToolState before = rig.state;
      ToolPath path;
      const ToolStep step = rig.Step(hand, &path);
      ++steps;
      if (before.placed && !before.buried) falls += FallsOfTheFree(rig, before.pose, path);
      ejected += step.mode == ProxyMode::kEjecting && !step.capped;
      buried += rig.state.buried;
      if (rig.state.buried || step.capped) continue;
      ToolJudge judge(rig.surface, rig.tool);
      inside += judge.Falls(step.pose, step.pose) > 0;
    }
  }
  EXPECT_GT(ejected, steps / 200);
  EXPECT_GT(buried, steps / 200);
  EXPECT_EQ(inside, 0);
  EXPECT_EQ(falls, 0) << "of balls that were free";
}

// --- Rest

TEST(ToolTorture, AToolRestsWhereNothingFreeIsNearer) {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Vec3(normal(random), normal(random), normal(random)); };
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  const int steps = std::max(600, test::Scaled(1500));
  int rests = 0, sticks = 0;
  for (const int balls : {1, 8, 24}) {
    ToolRig rig(gyroid.surface, Rod(balls, 16.0));
    ToolPose hand, goal;
    for (int n = 0; n < steps; ++n) {
      if (n % 100 == 0) {
        goal = Moved(rig.state.pose, {6.0 * vector().normalized(), 0.3 * vector().normalized()});
      }
      const ToolMove way = MoveBetween(rig.state.pose, goal);
      hand = Moved(
          rig.state.pose,
          way * (2.0 / std::max(2.0, std::hypot(way.way_mm.norm(), 10.0 * way.turn_rad.norm()))));
      const ToolStep step = rig.Step(hand);
      if (n % 20 != 0 || step.mode != ProxyMode::kConstrained) continue;
      ++rests;
      ToolJudge judge(gyroid.surface, rig.tool);
      const double nearer_mm = judge.NearerBySearch(random, step.pose, hand);
      sticks += nearer_mm > 0.01 + 0.01 * judge.Distance(step.pose, hand);
    }
  }
  EXPECT_GT(rests, steps / 30);
  EXPECT_EQ(sticks, 0) << "of " << rests;
}

}  // namespace
}  // namespace palpate
