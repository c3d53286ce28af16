// Rigid tools on exact geometry.
#include "server/haptics/tool/tool_step.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "server/haptics/proxy.h"
#include "server/haptics/tool/least_move.h"
#include "tests/support/made_volume.h"
#include "tests/support/tick_rig.h"
#include "tests/support/tool_rig.h"

namespace palpate {
namespace {

using testing::Rod;
using testing::ToolRig;
using testing::Turn;

constexpr double kStandoffMm = 1e-3;
const Vec3 kX = Vec3::UnitX(), kY = Vec3::UnitY(), kZ = Vec3::UnitZ();

// The force at stiffness 1 N/mm, and the torque about the grip, on the hand.
struct Pull {
  Vec3 force_n, torque_n_mm;
};
Pull PullOf(const RigidTool& tool, const ToolPose& at, const ToolPose& hand) {
  const ToolMove back = MoveBetween(hand, at);
  const double rho = tool.rotation_length_mm;
  return {back.way_mm, rho * rho * back.turn_rad};
}

// --- Turns

TEST(ToolPoses, AMoveLeadsFromOnePoseToTheOther) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  for (const double angle_rad : {0.0, 1e-9, 0.01, 0.25, 0.5, 1.5, 3.0, 3.1415}) {
    const Vec3 axis = Vec3(normal(random), normal(random), normal(random)).normalized();
    const ToolPose from{Vec3(1, 2, 3), Turn(1.0, kX + kZ)};
    const ToolPose to{Vec3(-1, 5, 3), Turn(angle_rad, axis) * from.R_DS};
    const ToolMove move = MoveBetween(from, to);
    EXPECT_LE((move.turn_rad - angle_rad * axis).norm(), 1e-13 + 1e-9 * (angle_rad > 3.1));
    if (angle_rad > kLongestTurnRad) continue;
    const ToolPose moved = Moved(from, move);
    EXPECT_LE((moved.p_DS_mm - to.p_DS_mm).norm(), 1e-14);
    EXPECT_LE(moved.R_DS.angularDistance(to.R_DS), 1e-9);
  }
}

// --- The nearest move

// A random search in the limits finds nothing nearer, whether they are few or many, and some equal.
TEST(LeastMove, NothingInTheLimitsIsNearer) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  const auto vector = [&] {
    Vec6 v;
    for (int n = 0; n < 6; ++n) v[n] = normal(random);
    return v;
  };
  for (int run = 0; run < 300; ++run) {
    std::vector<MoveLimit> limits;
    for (int n = 0; n < run % 40; ++n) {
      limits.push_back(
          {vector().normalized(), run % 3 == 0 ? 0.0 : -0.3 * std::abs(normal(random))});
      if (n % 5 == 4) limits.push_back(limits.front());
    }
    const Vec6 wanted = vector();
    const LeastMove move = NearestMove(wanted, limits, 1e-12);
    ASSERT_TRUE(move.feasible);
    const auto lack = [&](const Vec6& x) {
      double most = 0.0;
      for (const MoveLimit& limit : limits) most = std::max(most, limit.least - limit.along.dot(x));
      return most;
    };
    EXPECT_LE(lack(move.x), 1e-9);
    for (int n = 0; n < 300; ++n) {
      const Vec6 other = move.x + 0.1 * vector();
      if (lack(other) > 0.0) continue;
      EXPECT_GE((wanted - other).norm(), (wanted - move.x).norm() - 1e-9);
    }
  }
}

TEST(LeastMove, SaysWhatCannotBe) {
  Vec6 up = Vec6::Unit(2);
  EXPECT_FALSE(
      NearestMove(Vec6::Zero(), std::vector<MoveLimit>{{up, 1.0}, {-up, 0.0}}, 1e-9).feasible);
}

// --- Exact geometry

TEST(ToolStep, InFreeSpaceTheToolIsAtTheStylus) {
  const auto floor = testing::PlaceFloor();
  ToolRig rig(floor.surface, Rod(8, 10.0));
  rig.Step({Vec3(0, 0, 5), Eigen::Quaterniond::Identity()});
  const ToolPose hand{Vec3(2, -1, 7), Turn(0.4, kX + kY)};
  const ToolStep step = rig.Step(hand);
  EXPECT_EQ(step.pose.p_DS_mm, hand.p_DS_mm);
  EXPECT_EQ(step.pose.R_DS.coeffs(), hand.R_DS.coeffs());
  EXPECT_EQ(step.mode, ProxyMode::kFree);
}

// Two balls 20 mm apart on a floor, the grip between them, pressed 1 mm deep. Tilted little, both
// stay on the floor and the whole torque is felt; tilted more, one lifts off, and the torque is the
// other's force by its arm.
TEST(ToolStep, TwoBallsOnAFloorCarryForceAndTorque) {
  const auto floor = testing::PlaceFloor();
  RigidTool tool = Rod(2, 0.0);
  tool.ball[0].p_SBall_mm = -10.0 * kX;
  tool.ball[1].p_SBall_mm = 10.0 * kX;
  const double rho = tool.rotation_length_mm;
  for (const double tilt_rad : {0.0, 0.005, 0.01, 0.02, 0.05}) {
    ToolRig rig(floor.surface, tool);
    rig.Step({Vec3(0, 0, 3), Eigen::Quaterniond::Identity()});
    const ToolPose hand{Vec3(0, 0, -1), Turn(tilt_rad, kY)};
    const ToolStep step = rig.Step(hand);
    const auto [force_n, torque_n_mm] = PullOf(tool, step.pose, hand);
    if (rho * rho * tilt_rad < 10.0) {
      EXPECT_EQ(step.touching, 3u);
      EXPECT_NEAR(force_n.z(), 1.0, 2.0 * kStandoffMm);
      EXPECT_NEAR(torque_n_mm.y(), -rho * rho * tilt_rad, 0.01);
    } else {
      EXPECT_EQ(step.touching, 2u) << "turned about y, the ball at +x is the lower one";
      const Vec3 arm_mm = step.pose.R_DS * tool.ball[1].p_SBall_mm;
      EXPECT_LE((torque_n_mm - arm_mm.cross(force_n)).norm(), 0.01);
      EXPECT_NEAR(lab::BallAt(tool, step.pose, 1).z(), 0.0, 1.1 * kStandoffMm);
    }
    EXPECT_LE(force_n.head<2>().norm(), 1e-6);
  }
}

// A rod in a tube, turned across it: both ends touch, and what is left is a pure torque.
TEST(ToolStep, ARodInATubeIsHeldByAPureTorque) {
  const auto volume = testing::MakeVolume(
      Vec3i(41, 41, 41), [](int i, int j, int) { return std::hypot(i - 20.0, j - 20.0); });
  const double tau = volume->Normalize(8.0);
  const HapticSurface surface = MakeHapticSurface(
      *volume, {Mat3::Identity(), Vec3::Constant(-20.0)}, tau, DecompositionMethod::kTpbcc, 1);
  RigidTool tool = Rod(9, 28.0);
  for (int n = 0; n < tool.count; ++n) tool.ball[n].p_SBall_mm.z() -= 14.0;
  ToolRig rig(surface, tool);
  ToolPose hand;
  rig.Step(hand);
  ToolStep step;
  for (int n = 1; n <= 100; ++n) {
    hand.R_DS = Turn(0.008 * n, kX);
    step = rig.Step(hand);
  }
  const auto [force_n, torque_n_mm] = PullOf(tool, step.pose, hand);
  // Held at 8 mm by an arm of 14 mm.
  const double held_rad = step.pose.R_DS.angularDistance(Eigen::Quaterniond::Identity());
  EXPECT_NEAR(std::sin(held_rad), 8.0 / 14.0, 0.02);
  EXPECT_LE(force_n.norm(), 0.1);
  EXPECT_NEAR(torque_n_mm.x(), -900.0 * (0.8 - held_rad), 5.0);
  EXPECT_EQ(step.touching & 0x101u, 0x101u);

  // A jam neither drifts nor chatters.
  const ToolPose rest = step.pose;
  for (int n = 0; n < 300; ++n) {
    const ToolPose next = rig.Step(hand).pose;
    EXPECT_LE((next.p_DS_mm - rest.p_DS_mm).norm(), kStandoffMm);
    EXPECT_LE(next.R_DS.angularDistance(rest.R_DS), kStandoffMm / 14.0);
  }
}

// A rod across an edge of a box: the torque is the force by the arm to the edge, none about the
// rod.
TEST(ToolStep, ARodOverAnEdgeTurnsAboutIt) {
  const auto volume = testing::MakeVolume(Vec3i(41, 41, 41), [](int i, int, int k) {
    return std::min({1.0, 0.5 + (20.5 - i) / 4.0, 0.5 + (20.5 - k) / 4.0});
  });
  const HapticSurface surface =
      MakeHapticSurface(*volume, {Mat3::Identity(), Vec3::Constant(-20.0)}, volume->Normalize(0.5),
                        DecompositionMethod::kTpbcc, 1);
  RigidTool tool = Rod(31, 30.0);
  ToolRig rig(surface, tool);
  const Eigen::Quaterniond along_x = Turn(std::numbers::pi / 2, kY);
  ToolStep step;
  ToolPose hand;
  for (int n = 0; n <= 1000; ++n) {
    hand = {Vec3(-8, 0, 48.0 - 0.05 * n), Turn(0.8, kY) * along_x};
    step = rig.Step(hand);
  }
  ASSERT_EQ(step.mode, ProxyMode::kConstrained);
  // The balls on both sides of the edge, one by one or together, are within a mm of it.
  const int ball = std::countr_zero(step.touching);
  const Vec3 arm_mm = lab::BallAt(tool, step.pose, ball) - step.pose.p_DS_mm;
  const auto [force_n, torque_n_mm] = PullOf(tool, step.pose, hand);
  EXPECT_GT(force_n.norm(), 0.5);
  EXPECT_LE((torque_n_mm - arm_mm.cross(force_n)).norm(), 1.0 * force_n.norm());
  EXPECT_LE(std::abs(torque_n_mm.dot(arm_mm.normalized())), 1e-3 * torque_n_mm.norm());
}

// A roof, and a ball that comes down on it just beside the ridge, straight against that side. Only
// on the other side is it nearer to the stylus.
TEST(ToolStep, ABallBesideARidgeGoesOverIt) {
  const auto roof = testing::MakeVolume(
      Vec3i(41, 41, 41), [](int i, int, int k) { return 30.0 - k - 0.5 * std::abs(i - 20); });
  const HapticSurface surface =
      MakeHapticSurface(*roof, {Mat3::Identity(), Vec3(-20, -20, -20)}, roof->Normalize(10.0),
                        DecompositionMethod::kTpbcc, 1);
  const Vec3 normal = Vec3(-0.5, 0.0, 1.0).normalized();
  for (const double beside_mm : {1e-4, 1e-3, 5e-3, 0.02}) {
    ToolRig rig(surface, Rod(2, 15.0));
    const Vec3 on_roof_mm(-beside_mm, 0.3, -0.5 * beside_mm);
    rig.Step({on_roof_mm + 0.5 * normal, Eigen::Quaterniond::Identity()});
    const Vec3 hip_mm = on_roof_mm - 2.0 * normal;
    const ToolStep step = rig.Step({hip_mm, Eigen::Quaterniond::Identity()});
    // The other side's distance.
    const double depth_mm = -Vec3(0.5, 0.0, 1.0).normalized().dot(hip_mm);
    EXPECT_LE((step.pose.p_DS_mm - hip_mm).norm(), depth_mm + 2.0 * kStandoffMm) << beside_mm;
  }
}

// --- Against the point

TEST(ToolStep, OneBallIsFeltAsThePointIs) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  ToolRig rig(gyroid.surface, Rod(1, 0.0));
  const auto cache = std::make_unique<CellCache>();
  Proxy proxy;
  Vec3 hip_mm = Vec3::Zero(), way_mm = Vec3::Zero();
  int contacts = 0, deeper = 0;
  for (int n = 0; n < 20'000; ++n) {
    if (n % 200 == 0)
      way_mm = 0.1 * Vec3(normal(random), normal(random), normal(random)).normalized();
    hip_mm += way_mm;
    const ToolStep step = rig.Step({hip_mm, Eigen::Quaterniond::Identity()});
    if (rig.state.buried) continue;
    // Two who came to different places are put together again.
    if (!proxy.placed || (proxy.p_DH_mm - step.pose.p_DS_mm).norm() > 0.5) {
      proxy = Proxy();
      StepProxy(gyroid.surface, step.pose.p_DS_mm, 1e9, proxy, *cache);
    }
    const ProxyStep point = StepProxy(gyroid.surface, hip_mm, 1e9, proxy, *cache);
    const double excess_mm = (hip_mm - step.pose.p_DS_mm).norm() - (hip_mm - point.p_DH_mm).norm();
    contacts += step.mode == ProxyMode::kConstrained;
    deeper += excess_mm > 2.0 * kStandoffMm;
    hip_mm = hip_mm.cwiseMax(-30.0).cwiseMin(30.0);
    const Vec3 deep_mm = hip_mm - step.pose.p_DS_mm;
    if (deep_mm.norm() > 2.0) hip_mm = step.pose.p_DS_mm + 2.0 * deep_mm.normalized();
  }
  EXPECT_GT(contacts, 2000);
  EXPECT_LE(deeper, contacts / 100);
}

// --- Changes under load

TEST(ToolStep, WhatMovesUnderTheToolBringsItOutWithinFiftySteps) {
  const auto floor = testing::PlaceFloor();
  for (const double rise_mm : {0.3, 2.0, 4.0}) {
    ToolRig rig(floor.surface, Rod(8, 14.0));
    rig.eject_limit_mm = 6.6;
    rig.Step({Vec3(0, 0, 2), Turn(1.5, kX)});
    const ToolPose hand{Vec3(0, 0, -1), Turn(1.5, kX)};
    rig.Step(hand);
    rig.surface.isovalue -= rise_mm / 39.0;
    int steps = 1;
    while (rig.Step(hand).mode == ProxyMode::kEjecting && steps < 60) ++steps;
    EXPECT_LE(steps, 50);
    ASSERT_FALSE(rig.state.buried);
    for (int n = 0; n < rig.tool.count; ++n) {
      EXPECT_GE(lab::BallAt(rig.tool, rig.state.pose, n).z(), rise_mm);
    }
  }
}

// Nobody asked for a push where a hand happens to be.
TEST(ToolStep, TakenUpInTheObjectItIsBuried) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  ToolRig rig(floor.surface, Rod(4, 6.0));
  EXPECT_EQ(rig.Step({Vec3(0, 0, -0.5), Turn(0.0, kX)}).mode, ProxyMode::kInside);
  EXPECT_TRUE(rig.state.buried);
}

TEST(ToolStep, WhatIsTooDeepIsBuriedUntilTheStylusIsFree) {
  const auto floor = testing::PlaceFloor();
  ToolRig rig(floor.surface, Rod(8, 14.0));
  rig.eject_limit_mm = 1.0;
  rig.Step({Vec3(0, 0, 2), Eigen::Quaterniond::Identity()});
  rig.surface.isovalue -= 5.0 / 39.0;
  const ToolPose inside{Vec3(1, 0, 3), Eigen::Quaterniond::Identity()};
  const ToolStep step = rig.Step(inside);
  EXPECT_EQ(step.mode, ProxyMode::kInside);
  EXPECT_EQ(step.pose.p_DS_mm, inside.p_DS_mm) << "nothing is felt";
  EXPECT_EQ(rig.Step({Vec3(1, 0, 8), Eigen::Quaterniond::Identity()}).mode, ProxyMode::kFree);
  EXPECT_EQ(rig.Step(inside).mode, ProxyMode::kConstrained);
}

// --- Bounded, and the same again

// A teleport of a long tool through a gyroid takes several steps, each within its work.
TEST(ToolStep, WorkIsBoundedAndCarriedOver) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 0.33);
  ToolRig rig(gyroid.surface, Rod(64, 18.0));
  rig.Step({Vec3(0, 0, 30), Eigen::Quaterniond::Identity()});
  const ToolPose hand{Vec3(0, 5, -15), Turn(2.0, kY)};
  int capped = 0;
  for (int n = 0; n < 50; ++n) {
    const ToolStep step = rig.Step(hand);
    EXPECT_LE(step.work, rig.work);
    capped += step.capped;
  }
  EXPECT_GE(capped, 1);
  EXPECT_FALSE(rig.Step(hand).capped);
}

// No hop between two poses, and no creep.
TEST(ToolStep, UnderAHandAtRestItRests) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 0.33);
  std::mt19937_64 random(37);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int rests = 0;
  for (int n = 0; n < 4000; ++n) {
    ToolRig rig(gyroid.surface, Rod(4, 6.0));
    const Vec3 at = 8.0 * Vec3(uniform(random), uniform(random), uniform(random));
    if (rig.Step({at, Turn(uniform(random), kX)}).mode != ProxyMode::kFree) continue;
    const Vec3 to = at + 4.0 * Vec3(uniform(random), uniform(random), uniform(random));
    const ToolPose hand{to, Turn(uniform(random), kX + kZ)};
    ToolStep step;
    for (int k = 0; k < 30; ++k) step = rig.Step(hand);
    if (step.capped || step.mode != ProxyMode::kConstrained) continue;
    ++rests;
    const Vec3 rest_mm = step.pose.p_DS_mm;
    for (int k = 0; k < 20; ++k) EXPECT_EQ(rig.Step(hand).pose.p_DS_mm, rest_mm) << n;
  }
  EXPECT_GT(rests, 50);
}

// Where so many planes are around the balls that looking at them leaves no work for a move, the
// tool does not stay for ever.
TEST(ToolStep, NoCapHoldsATool) {
  const auto noise = testing::MakeVolume(Vec3i(24, 24, 24), [](int i, int j, int k) {
    return static_cast<double>((i * 7919 + j * 104729 + k * 1299709) % 101 % 7);
  });
  const HapticSurface surface =
      MakeHapticSurface(*noise, {0.01 * Mat3::Identity(), Vec3::Constant(-0.12)},
                        noise->Normalize(4.5), DecompositionMethod::kTpbcc, 1);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-0.15, 0.15);
  ToolRig rig(surface, Rod(64, 0.08));
  int begun = 0, most = 0, capped = 0;
  for (int n = 0; n < 2000; ++n) {
    const Eigen::Quaterniond turn = Turn(20.0 * uniform(random), kY);
    const ToolPose hand{{uniform(random), uniform(random), uniform(random)}, turn};
    for (int k = 0; k < 20; ++k) {
      const ToolStep step = rig.Step(hand);
      capped += step.capped;
      begun = step.capped && step.rounds == 1 ? begun + 1 : 0;
      most = std::max(most, begun);
    }
  }
  EXPECT_GT(capped, 100);
  EXPECT_LE(most, 10);
}

TEST(ToolStep, DoesNotDependOnItsCache) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  ToolRig rig(gyroid.surface, Rod(16, 16.0)), other(gyroid.surface, Rod(16, 16.0));
  for (int n = 0; n < 300; ++n) {
    const ToolPose hand{Vec3(0.1 * n, 5.0, 8.0 - 0.05 * n), Turn(0.01 * n, kX + kZ)};
    if (n % 10 == 0) other.cache = std::make_unique<ToolCellCache>();
    const ToolPose a = rig.Step(hand).pose, b = other.Step(hand).pose;
    ASSERT_EQ(a.p_DS_mm, b.p_DS_mm);
    ASSERT_EQ(a.R_DS.coeffs(), b.R_DS.coeffs());
  }
}

}  // namespace
}  // namespace palpate
