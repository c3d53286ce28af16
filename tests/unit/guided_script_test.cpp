// Scripts of the simulated hand: that which follows plans (where it has one, where it has none, and
// where one comes or goes), that along a path, and that which presses buttons.
#include "server/simulated_hand/guided_script.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/fixed_scripts.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/allocation_count.h"
#include "tests/support/device_numbers.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using test::kInfinity;
using test::kNan;
using test::kTickS;
using test::SameBits;

constexpr double kStiffness = 0.5;  // N/mm

std::unique_ptr<StylusScript> Explore() {
  const DeviceDescription spec = SimulatedDeviceSpec();
  return std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, 1);
}

// Lines along x on the plane z = 0, 20 mm apart; the hand a millimetre below.
TouchStroke Line(double y_mm, int points) {
  TouchStroke stroke{.points = {}, .least_s = 1.5, .lift_to_next_mm = 5.0};
  for (int n = 0; n < points; ++n) {
    const Vec3 p_mm(0.5 * n - 10.0, y_mm, 0.0);
    stroke.points.push_back({.p_D_mm = p_mm,
                             .normal_D = Vec3::UnitZ(),
                             .p_DHand_mm = p_mm - Vec3::UnitZ(),
                             .speed_mm_s = 40.0});
  }
  return stroke;
}

TouchPlan Lines() {
  return {.strokes = {Line(-20.0, 40), Line(0.0, 1), Line(20.0, 40)},
          .stiffness_n_per_mm = kStiffness};
}

class GuidedTest : public ::testing::Test {
 protected:
  GuidedTest() : device_(std::make_unique<GuidedScript>(Explore(), plans_)) { device_.Start(); }

  void Publish(TouchPlan plan) { plans_.Publish(std::make_unique<TouchPlan>(std::move(plan))); }

  Vec3 Read() {
    DeviceState state;
    EXPECT_EQ(device_.Read(state), DeviceStatus::kOk);
    return state.p_MHip_mm;
  }

  // Material below z = 0.
  struct Run {
    int contacts = 0;
    double fastest_mm_s = 0.0;
    double deepest_mm = 0.0;
    double least_y_mm = 1e9, most_y_mm = -1e9;  // in contact
  };
  Run Feel(int ticks) {
    Run run;
    Vec3 last_mm = Read();
    for (int n = 0; n < ticks; ++n) {
      const Vec3 p_mm = Read();
      const double depth_mm = std::max(0.0, -p_mm.z());
      device_.Write({{kStiffness * depth_mm * Vec3::UnitZ()}}, kTickS);
      run.deepest_mm = std::max(run.deepest_mm, depth_mm);
      if (depth_mm > 0.0) {
        ++run.contacts;
        run.least_y_mm = std::min(run.least_y_mm, p_mm.y());
        run.most_y_mm = std::max(run.most_y_mm, p_mm.y());
      }
      if (n % 10 == 9) {
        run.fastest_mm_s = std::max(run.fastest_mm_s, (p_mm - last_mm).norm() / (10.0 * kTickS));
        last_mm = p_mm;
      }
    }
    return run;
  }

  TouchPlanInbox plans_;
  SimulatedDevice device_;
};

TEST_F(GuidedTest, WithoutAPlanIsTheOtherScript) {
  SimulatedDevice plain(Explore());
  plain.Start();
  for (int n = 0; n < 5000; ++n) {
    // One that holds nothing is none.
    if (n == 2500) Publish({});
    DeviceState state;
    plain.Read(state);
    const Vec3 p_mm = Read();
    ASSERT_TRUE(SameBits(p_mm, state.p_MHip_mm)) << n;
    const Vec3 force_n = p_mm.norm() < 25.0 ? Vec3(0.5 * (25.0 - p_mm.norm()) * p_mm.normalized())
                                            : Vec3(Vec3::Zero());
    plain.Write({{force_n}}, kTickS);
    device_.Write({{force_n}}, kTickS);
  }
}

TEST_F(GuidedTest, TouchesEveryStrokeAtItsDepth) {
  Publish(Lines());
  Feel(3000);
  const Run run = Feel(12'000);
  EXPECT_GT(run.contacts, 9000);
  EXPECT_LT(run.fastest_mm_s, 150.0);
  EXPECT_LT(run.least_y_mm, -19.9);
  EXPECT_GT(run.most_y_mm, 19.9);
  // Against the force, too, it is where the plan has it.
  EXPECT_LT(run.deepest_mm, 1.15);
}

TEST_F(GuidedTest, StaysOnASingleGrain) {
  Publish({.strokes = {Line(3.0, 1)}, .stiffness_n_per_mm = kStiffness});
  Feel(3000);
  EXPECT_EQ(Feel(5000).contacts, 5000);
}

TEST_F(GuidedTest, TakesANewPlanWithoutALeap) {
  Publish(Lines());
  Feel(4000);
  for (int n = 0; n < 20; ++n) {
    TouchPlan plan = Lines();
    for (TouchStroke& stroke : plan.strokes) {
      for (TouchPoint& point : stroke.points) {
        point.p_D_mm.x() += 0.05 * n;
        point.p_DHand_mm.x() += 0.05 * n;
      }
    }
    Publish(std::move(plan));
    const Run run = Feel(200);
    EXPECT_LT(run.fastest_mm_s, 150.0);
  }
  Feel(2000);
  EXPECT_GT(Feel(6000).contacts, 4000);
}

TEST_F(GuidedTest, ExploresOnWhenThePlanIsTakenAway) {
  Publish(Lines());
  Feel(4000);
  Publish({});
  const Run run = Feel(3000);
  EXPECT_LT(run.fastest_mm_s, 180.0);
  Eigen::AlignedBox3d seen;
  for (int n = 0; n < 10'000; ++n) {
    seen.extend(Read());
    device_.Write({}, kTickS);
  }
  EXPECT_GT(seen.sizes().minCoeff(), 20.0);
  Publish(Lines());
  Feel(3000);
  EXPECT_GT(Feel(6000).contacts, 4000);
}

// Through whatever is there: it must be out when the other volume comes.
TEST_F(GuidedTest, MakesRoomForAnotherVolumeAndWaitsForItsPlan) {
  Publish(Lines());
  Feel(3000);
  const Vec3 free_mm(12.0, -8.0, -25.0);  // below what it feels now
  Publish({.strokes = {}, .p_DFree_mm = {Vec3(70, 50, 30), free_mm}, .makes_room = true});
  EXPECT_FALSE(plans_.is_out);
  Feel(1000);
  EXPECT_TRUE(plans_.is_out);
  EXPECT_LT((Read() - free_mm).norm(), 5.0);
  Feel(1000);
  EXPECT_LT((Read() - free_mm).norm(), 5.0);
  Publish(Lines());
  Feel(3000);
  EXPECT_GT(Feel(6000).contacts, 4000);
}

TEST_F(GuidedTest, ExploresIfTheOtherVolumeDoesNotCome) {
  const Vec3 free_mm(0.0, 0.0, 25.0);
  Publish({.strokes = {}, .p_DFree_mm = {free_mm}, .makes_room = true});
  Feel(1000);
  EXPECT_LT((Read() - free_mm).norm(), 2.0);
  double farthest_mm = 0.0;
  for (int n = 0; n < 100; ++n) {
    Feel(100);
    farthest_mm = std::max(farthest_mm, (Read() - free_mm).norm());
  }
  EXPECT_GT(farthest_mm, 10.0);
}

// The surface was moved over the hand: nothing is felt until the hand is out.
TEST_F(GuidedTest, ComesOutWhereItFeelsNothing) {
  TouchPlan plan = Lines();
  plan.p_DFree_mm = {Vec3(0.0, 0.0, 20.0)};
  Publish(std::move(plan));
  Feel(3000);
  double highest_mm = -100.0;
  for (int n = 0; n < 3000; ++n) {
    highest_mm = std::max(highest_mm, Read().z());
    device_.Write({}, kTickS);
  }
  EXPECT_GT(highest_mm, 17.0);
}

// A wall that the plan does not know: the hand stops, tries another stroke, and explores.
TEST_F(GuidedTest, DoesNotPushThroughWhatIsInTheWay) {
  Publish(Lines());
  Feel(500);
  double most_n = 0.0;
  for (int n = 0; n < 20'000; ++n) {
    const Vec3 p_mm = Read();
    const double depth_mm = std::max(0.0, 15.0 - p_mm.z());
    const Vec3 force_n = kStiffness * depth_mm * Vec3::UnitZ();
    if (n > 1000) most_n = std::max(most_n, force_n.norm());
    device_.Write({{force_n}}, kTickS);
  }
  EXPECT_LT(most_n, 2.5);
}

// Also on the way to a stroke, and back without a leap.
TEST_F(GuidedTest, TurnsTheBarrelAlongTheNormalsWhereThePlanSaysSo) {
  const auto barrel = [&] {
    DeviceState state;
    device_.Read(state);
    return Vec3(state.R_MS * Vec3::UnitZ());
  };
  const Vec3 normal_D = Vec3(0.6, 0.0, 0.8);
  TouchPlan plan = Lines();
  for (TouchStroke& stroke : plan.strokes) {
    for (TouchPoint& point : stroke.points) point.normal_D = normal_D;
  }
  Publish(plan);
  Feel(3000);
  EXPECT_GT((barrel() - normal_D).norm(), 0.3);
  plan.turns_stylus = true;
  Publish(plan);
  double fastest_rad_s = 0.0;
  const auto feel = [&](int ticks, const Vec3& least_D, double least) {
    for (int n = 0; n < ticks; ++n) {
      const Vec3 before = barrel();
      Feel(1);
      fastest_rad_s = std::max(fastest_rad_s, (barrel() - before).norm() / kTickS);
      ASSERT_GE(barrel().dot(least_D), least) << n;
    }
  };
  feel(2000, normal_D, 0.0);
  feel(4000, normal_D, 1.0 - 1e-6);
  Publish({});
  feel(3000, normal_D, -1.0);
  EXPECT_GT((barrel() - normal_D).norm(), 0.3);
  EXPECT_LT(fastest_rad_s, 8.1);
}

TEST_F(GuidedTest, StaysFiniteWhateverIsWritten) {
  Publish(Lines());
  for (int n = 0; n < 20'000; ++n) {
    const double force_n = n % 7 == 0 ? kInfinity : n % 5 == 0 ? kNan : n % 40 - 20.0;
    const double dt_s = n % 11 == 0 ? 0.0 : n % 13 == 0 ? 10.0 : n % 17 == 0 ? -1.0 : kTickS;
    device_.Write({{Vec3(force_n, -force_n, 0.3 * force_n)}}, dt_s);
    ASSERT_TRUE(Read().allFinite());
  }
}

// One after the other; the device's stops would hide it if only the place were looked at.
TEST_F(GuidedTest, LongTicksDoNotSwingItUp) {
  Publish(Lines());
  double longest_mm = 0.0;
  for (int n = 0; n < 2000; ++n) {
    const Vec3 before_mm = Read();
    device_.Write({}, 0.012);
    if (n > 100) longest_mm = std::max(longest_mm, (Read() - before_mm).norm());
  }
  EXPECT_LT(longest_mm, 3.0);
}

TEST_F(GuidedTest, NeverAllocates) {
  Publish(Lines());
  std::uint64_t before = test::Allocations();
  auto other = std::make_unique<TouchPlan>(Lines());
  other->turns_stylus = true;
  EXPECT_GT(test::Allocations(), before);  // they are counted
  before = test::Allocations();
  Feel(6000);
  EXPECT_EQ(test::Allocations(), before);
  plans_.Publish(std::move(other));
  before = test::Allocations();
  Feel(6000);
  EXPECT_EQ(test::Allocations(), before);
  plans_.Publish(std::make_unique<TouchPlan>(
      TouchPlan{.strokes = {}, .p_DFree_mm = {Vec3(0, 0, 20), Vec3(9, 9, 9)}, .makes_room = true}));
  before = test::Allocations();
  Feel(6000);  // out, and on by touch alone
  EXPECT_EQ(test::Allocations(), before);
}

TEST(Scripts, RefuseWhatTheyCannotFollow) {
  TouchPlanInbox plans;
  EXPECT_EQ(testing::Refusal([&] { GuidedScript(nullptr, plans); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(testing::Refusal([] { PressScript(nullptr, 1); }), ErrorKind::kInvalidArgument);
  const std::pair<std::vector<Vec3>, double> no_paths[] = {{{}, 10.0},
                                                           {{Vec3::Zero()}, 0.0},
                                                           {{Vec3::Zero()}, kNan},
                                                           {{Vec3(0.0, kInfinity, 0.0)}, 10.0}};
  for (const auto& path : no_paths) {
    EXPECT_EQ(testing::Refusal([&] { PathScript(path.first, path.second); }),
              ErrorKind::kInvalidArgument);
  }
}

TEST(PathScript, KeepsItsSpeedRoundCornersAndDoesNotAllocate) {
  PathScript path({Vec3::Zero(), Vec3(3.0, 0.0, 0.0), Vec3(3.0, 4.0, 0.0)}, 12.0);
  const HandState hand;
  const std::uint64_t before = test::Allocations();
  // The round is 3 + 4 + 5 mm: one second.
  EXPECT_LT((path.Next(hand, {}, 0.5).p_MTarget_mm - Vec3(3.0, 3.0, 0.0)).norm(), 1e-9);
  EXPECT_LT((path.Next(hand, {}, 0.5).p_MTarget_mm - Vec3::Zero()).norm(), 1e-9);
  EXPECT_LT((path.Next(hand, {}, 0.25).p_MTarget_mm - Vec3(3.0, 0.0, 0.0)).norm(), 1e-9);
  EXPECT_EQ(test::Allocations(), before);
}

std::unique_ptr<StylusScript> PressedPath() {
  return std::make_unique<PathScript>(std::vector<Vec3>{Vec3(0, 0, 0), Vec3(100, 0, 0)}, 50.0);
}

TEST(PressScript, HoldsTheButtonsForAThirdOfTheTimeAndLeavesTheWay) {
  PressScript script(PressedPath(), 2u);
  const auto plain = PressedPath();
  int pressed = 0, presses = 0;
  std::uint32_t last = 0;
  for (int n = 0; n < 30'000; ++n) {
    const StylusScript::Target target = script.Next({}, {}, 1e-3);
    EXPECT_EQ(target.p_MTarget_mm, plain->Next({}, {}, 1e-3).p_MTarget_mm);
    EXPECT_EQ(target.buttons & ~2u, 0u);
    pressed += target.buttons == 2u;
    presses += target.buttons != 0 && last == 0;
    last = target.buttons;
  }
  EXPECT_NEAR(pressed, 10'000, 20);
  EXPECT_EQ(presses, 10);
}

TEST(PressScript, HoldsNoneWhereThereAreNone) {
  PressScript script(PressedPath(), 0);
  for (int n = 0; n < 5000; ++n) EXPECT_EQ(script.Next({}, {}, 1e-3).buttons, 0u);
}

}  // namespace
}  // namespace palpate
