// The hand that a person leads: how it follows targets that come unevenly, what contact does to it,
// and how it changes between the person and each other script.
#include "server/simulated_hand/led_hand.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/fixed_scripts.h"
#include "server/simulated_hand/guided_script.h"
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

constexpr double kWallNPerMm = 0.5;  // N/mm
constexpr double kTurn = 2.0 * std::numbers::pi;

std::unique_ptr<StylusScript> Explorer() {
  const DeviceDescription spec = SimulatedDeviceSpec();
  return std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, 1);
}

// So fine that speeds can be read off the places.
DeviceDescription FineSpec() {
  DeviceDescription spec = SimulatedDeviceSpec();
  spec.position_resolution_mm = 1e-9;
  return spec;
}

std::unique_ptr<LedScript> Led(LedHand& led, std::unique_ptr<StylusScript> unled = Explorer()) {
  const DeviceDescription spec = SimulatedDeviceSpec();
  return std::make_unique<LedScript>(std::move(unled), led, spec.workspace_min_mm,
                                     spec.workspace_max_mm);
}

DeviceState StateOf(SimulatedDevice& device) {
  DeviceState state;
  EXPECT_EQ(device.Read(state), DeviceStatus::kOk);
  return state;
}

Vec3 PlaceOf(SimulatedDevice& device) { return StateOf(device).p_MHip_mm; }

// Material below z = 0.
Vec3 Wall(const Vec3& p_mm) { return kWallNPerMm * std::max(0.0, -p_mm.z()) * Vec3::UnitZ(); }

// Speeds and accelerations, of places that are a tick apart.
class Motion {
 public:
  void Add(const Vec3& p_mm) {
    const Vec3 v_mm_s = (p_mm - p_mm_) / kTickS;
    if (count_ > 0) most_mm_s = std::max(most_mm_s, v_mm_s.norm());
    if (count_ > 1) most_mm_s2 = std::max(most_mm_s2, (v_mm_s - v_mm_s_).norm() / kTickS);
    p_mm_ = p_mm;
    v_mm_s_ = v_mm_s;
    ++count_;
  }
  double most_mm_s = 0.0;
  double most_mm_s2 = 0.0;

 private:
  int count_ = 0;
  Vec3 p_mm_ = Vec3::Zero();
  Vec3 v_mm_s_ = Vec3::Zero();
};

class LedTest : public ::testing::Test {
 protected:
  LedTest() { device_.Start(); }

  void MoveTo(const Vec3& p_mm, std::uint32_t buttons = 0) { led_.MoveTo(lead_, p_mm, buttons); }
  // With nothing in the way.
  void Settle(const Vec3& p_mm) {
    MoveTo(p_mm);
    for (int n = 0; n < 800; ++n) device_.Write({}, kTickS);
  }

  LedHand led_;
  LedHand::Lead lead_ = led_.Take("a test");
  SimulatedDevice device_{Led(led_), FineSpec()};
};

constexpr double kRadiusMm = 25.0;
constexpr double kCircleMmPerS = kTurn * kRadiusMm;  // once a second

Vec3 OnCircle(double time_s) {
  const double angle = kTurn * time_s;
  return {kRadiusMm * std::cos(angle), kRadiusMm * std::sin(angle), 5.0};
}

// The ticks in which a pointer's targets come: 60 per second, each up to so late.
std::vector<bool> ComesAt(int ticks, int most_late_ms) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> late_ms(0, most_late_ms);
  std::vector<bool> comes(static_cast<std::size_t>(ticks));
  for (int n = 0; n < ticks * 60 / 1000; ++n) {
    const auto tick = static_cast<std::size_t>(n * 1000 / 60 + late_ms(random));
    if (tick < comes.size()) comes[tick] = true;
  }
  return comes;
}

struct Circled {
  double most_lag_s = 0.0;
  double most_away_mm = 0.0;  // from the circle
  Motion motion;
};

TEST_F(LedTest, FollowsAPointerSmoothly) {
  const auto circle = [this](int most_late_ms) {
    constexpr int kTicks = 4000, kSettled = 1000;
    Settle(OnCircle(0.0));
    const std::vector<bool> comes = ComesAt(kTicks, most_late_ms);
    Circled circled;
    for (int n = 0; n < kTicks; ++n) {
      if (comes[static_cast<std::size_t>(n)]) MoveTo(OnCircle(n * kTickS));
      device_.Write({}, kTickS);
      if (n < kSettled) continue;
      const Vec3 p_mm = PlaceOf(device_);
      circled.motion.Add(p_mm);
      const double at_s = std::atan2(p_mm.y(), p_mm.x()) / kTurn;
      circled.most_lag_s = std::max(circled.most_lag_s, std::remainder(n * kTickS - at_s, 1.0));
      circled.most_away_mm =
          std::max(circled.most_away_mm, std::abs(p_mm.head<2>().norm() - kRadiusMm));
    }
    return circled;
  };
  const Circled even = circle(0);
  const Circled late = circle(8);
  EXPECT_LT(even.most_lag_s, 0.035);
  EXPECT_LT(late.most_lag_s, 0.040);
  EXPECT_LT(even.most_away_mm, 0.15);
  EXPECT_LT(late.most_away_mm, 0.2);
  EXPECT_LT(even.motion.most_mm_s, 1.05 * kCircleMmPerS);
  EXPECT_LT(late.motion.most_mm_s, 1.4 * kCircleMmPerS);
  EXPECT_LT(even.motion.most_mm_s2, 3'000.0);
  EXPECT_LT(late.motion.most_mm_s2, 12'000.0);
}

TEST_F(LedTest, GoesToAFarTargetAtABoundedSpeed) {
  Settle(Vec3(-60.0, 0.0, 0.0));
  MoveTo(Vec3(60.0, 0.0, 0.0));
  Motion motion;
  double farthest_mm = 0.0;
  for (int n = 0; n < 400; ++n) {
    device_.Write({}, kTickS);
    motion.Add(PlaceOf(device_));
    farthest_mm = std::max(farthest_mm, PlaceOf(device_).x());
  }
  EXPECT_LT(motion.most_mm_s, 1.02 * kLedMmPerS);
  EXPECT_LT(motion.most_mm_s2, 25'000.0);
  EXPECT_LT(farthest_mm, 60.05);
  EXPECT_NEAR(PlaceOf(device_).x(), 60.0, 0.05);
}

// The person feels a force as the distance between where they want the hand and where it is.
TEST_F(LedTest, AForceDeflectsItAsASpringDoes) {
  Settle(Vec3(3.0, 4.0, 2.0));
  EXPECT_LT((PlaceOf(device_) - Vec3(3.0, 4.0, 2.0)).norm(), 1e-3);
  for (const double depth_mm : {1.0, 4.0, 8.0, 12.0}) {
    const Vec3 target_mm(3.0, 4.0, -depth_mm);
    MoveTo(target_mm);
    for (int n = 0; n < 1000; ++n) device_.Write({{Wall(PlaceOf(device_))}}, kTickS);
    const Vec3 p_mm = PlaceOf(device_);
    EXPECT_LT((p_mm - target_mm - Wall(p_mm) / kHandSpringNPerMm).norm(), 1e-3) << depth_mm;
    EXPECT_LT(p_mm.z(), 0.0);
  }
}

TEST_F(LedTest, TargetsBeyondTheWorkspaceCountAsItsNearestPlace) {
  const DeviceDescription spec = SimulatedDeviceSpec();
  for (const double far_mm : {100.0, 1e6, 1e300}) {
    Settle(Vec3(far_mm, -far_mm, 7.0));
    const Vec3 nearest_mm(spec.workspace_max_mm.x(), spec.workspace_min_mm.y(), 7.0);
    EXPECT_LT((PlaceOf(device_) - nearest_mm).norm(), 1e-3) << far_mm;
  }
}

TEST_F(LedTest, LateTicksDoNotMakeItLagMore) {
  SimulatedDevice late(Led(led_), FineSpec());
  late.Start();
  for (int n = 0; n < 100; ++n) {
    MoveTo(Vec3(0.1 * n, 0.0, 0.0));
    for (int tick = 0; tick < 10; ++tick) device_.Write({}, kTickS);
    late.Write({}, 10.0 * kTickS);
    if (n > 50) {
      EXPECT_LT((PlaceOf(device_) - PlaceOf(late)).norm(), 0.2) << n;
    }
  }
}

// Scripts of the simulated hand that exist, and where each is led away and let go: in free space
// and in contact, at rest and moving.
TEST_F(LedTest, NothingLeapsWhereItIsTakenAndGivenBack) {
  TouchPlanInbox plans;
  TouchPlan plan{.strokes = {{.points = {}, .least_s = 1.5, .lift_to_next_mm = 5.0}},
                 .stiffness_n_per_mm = kWallNPerMm};
  for (int n = 0; n < 80; ++n) {
    const Vec3 p_mm(0.5 * n - 20.0, 0.0, 0.0);
    plan.strokes[0].points.push_back(
        {.p_D_mm = p_mm, .p_DHand_mm = p_mm - Vec3::UnitZ(), .speed_mm_s = 40.0});
  }
  plans.Publish(std::make_unique<TouchPlan>(plan));
  std::vector<std::unique_ptr<StylusScript>> scripts;
  scripts.push_back(Explorer());
  scripts.push_back(
      std::make_unique<PressScript>(std::make_unique<GuidedScript>(Explorer(), plans), 1));
  scripts.push_back(std::make_unique<PathScript>(
      std::vector<Vec3>{{-60.0, 10.0, 5.0}, {60.0, 10.0, -2.0}}, 100.0));
  for (std::size_t script = 0; script < scripts.size(); ++script) {
    LedHand led;
    SimulatedDevice device(Led(led, std::move(scripts[script])), FineSpec());
    device.Start();
    Motion motion;
    const auto run = [&](int ticks) {
      for (int n = 0; n < ticks; ++n) {
        device.Write({{Wall(PlaceOf(device))}}, kTickS);
        motion.Add(PlaceOf(device));
      }
    };
    for (int round = 0; round < 20; ++round) {
      run(1000 + 37 * round);
      const LedHand::Lead lead = led.Take("a test");
      // Where it is, as a viewer does it, and then to and fro above and below the surface.
      for (int n = 0; n < 60; ++n) {
        led.MoveTo(lead,
                   Vec3(20.0 * std::sin(0.1 * n), 10.0, 6.0 * std::cos(0.2 * round + 0.05 * n)), 0);
        run(16);
      }
      led.GiveBack(lead);
    }
    // A spring that is let go 60 mm away from its end would give three times this speed.
    EXPECT_LT(motion.most_mm_s, 1.05 * kLedMmPerS) << script;
    EXPECT_LT(motion.most_mm_s2, 40'000.0) << script;
  }
}

// A load waits for the hand to make room, and plans are freed when the hand has seen the next one.
TEST_F(LedTest, ALedHandKeepsNoLoadWaitingAndNoOldPlans) {
  TouchPlanInbox plans;
  LedHand led;
  SimulatedDevice device(Led(led, std::make_unique<GuidedScript>(Explorer(), plans)));
  device.Start();
  const LedHand::Lead lead = led.Take("a test");
  led.MoveTo(lead, Vec3(5.0, 0.0, 0.0), 0);
  for (int n = 0; n < 500; ++n) device.Write({}, kTickS);
  const Vec3 free_mm(0.0, 0.0, 30.0);
  const std::uint64_t newest = plans.Publish(std::make_unique<TouchPlan>(
      TouchPlan{.strokes = {}, .p_DFree_mm = {free_mm}, .makes_room = true}));
  device.Write({}, kTickS);
  EXPECT_TRUE(plans.is_out);
  EXPECT_EQ(plans.announced(), newest);
  for (int n = 0; n < 500; ++n) device.Write({}, kTickS);
  EXPECT_LT((PlaceOf(device) - Vec3(5.0, 0.0, 0.0)).norm(), 0.1);
  // Let go before the other volume comes, the hand goes where that one is not.
  led.GiveBack(lead);
  for (int n = 0; n < 1000; ++n) device.Write({}, kTickS);
  EXPECT_LT((PlaceOf(device) - free_mm).norm(), 2.0);
}

// Smoothly, at a bounded speed; and by itself again when it is given back.
TEST_F(LedTest, TurnsTheStylusAsItIsLed) {
  const Eigen::Quaterniond goal(Eigen::AngleAxisd(2.5, Vec3(1, -2, 0.5).normalized()));
  Settle(Vec3(5, 5, 5));
  double most_rad_s = 0.0;
  const auto go = [&](int ticks) {
    for (int n = 0; n < ticks; ++n) {
      const Eigen::Quaterniond before = StateOf(device_).R_MS;
      device_.Write({}, kTickS);
      most_rad_s = std::max(most_rad_s, before.angularDistance(StateOf(device_).R_MS) / kTickS);
    }
    return Eigen::Quaterniond(StateOf(device_).R_MS);
  };
  const Eigen::Quaterniond by_itself = go(1);
  // q and -q are one orientation.
  for (const double sign : {1.0, -1.0}) {
    led_.MoveTo(lead_, Vec3(5, 5, 5), 0, Eigen::Quaterniond(sign * goal.coeffs()));
    EXPECT_LT(go(1200).angularDistance(goal), 1e-3);
    EXPECT_LE(most_rad_s, kLedRadPerS + 1e-6);
  }
  led_.GiveBack(lead_);
  EXPECT_GT(go(1000).angularDistance(goal), 0.5);
  EXPECT_LT(most_rad_s, 8.1);
  EXPECT_GT(by_itself.angularDistance(goal), 0.5);
  for (const Eigen::Quaterniond& bad :
       {Eigen::Quaterniond(kNan, 0, 0, 0), Eigen::Quaterniond(0.5, 0, 0, 0)}) {
    EXPECT_EQ(testing::Refusal([&] { led_.MoveTo(lead_, Vec3::Zero(), 0, bad); }),
              ErrorKind::kInvalidArgument);
  }
}

TEST_F(LedTest, ItsButtonsAreThePersons) {
  LedHand led;
  SimulatedDevice device(Led(led, std::make_unique<PressScript>(Explorer(), 1)));
  device.Start();
  const LedHand::Lead lead = led.Take("a test");
  for (int n = 0; n < 7000; ++n) {
    const std::uint32_t buttons = n / 1000 % 2 == 0 ? 2 : 0;
    led.MoveTo(lead, Vec3::Zero(), buttons);
    device.Write({}, kTickS);
    ASSERT_EQ(StateOf(device).buttons, buttons);
  }
  led.GiveBack(lead);
  std::uint32_t seen = 0;
  for (int n = 0; n < 4000; ++n) {
    device.Write({}, kTickS);
    seen |= StateOf(device).buttons;
  }
  EXPECT_EQ(seen, 1u);
}

// Whatever is asked for and whatever pushes, twice with the same bits.
TEST_F(LedTest, AttackedItStaysFiniteBoundedAndTheSame) {
  const auto attack = [] {
    LedHand led;
    const DeviceDescription spec = SimulatedDeviceSpec();
    SimulatedDevice device(Led(led), spec);
    device.Start();
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> part(-1.0, 1.0);
    std::uniform_int_distribution<int> choice(0, 99);
    constexpr std::array<double, 6> kScales = {1.0, 30.0, 300.0, 1e9, 1e300, 1e-300};
    LedHand::Lead lead = 0;
    std::vector<Vec3> places_mm;
    for (int n = 0; n < 30'000; ++n) {
      const Vec3 target_mm = kScales[static_cast<std::size_t>(choice(random)) % kScales.size()] *
                             Vec3(part(random), part(random), part(random));
      const int what = choice(random);
      if (what < 2 && lead == 0) lead = led.Take("an attack");
      if (what == 2) led.GiveBack(std::exchange(lead, 0));
      if (what > 40) led.MoveTo(lead, target_mm, static_cast<std::uint32_t>(what));
      const double strange_n = what % 3 == 0 ? kInfinity : what % 3 == 1 ? kNan : 1e300;
      const Vec3 force_n = choice(random) == 0 ? Vec3(strange_n, 1.0, -strange_n)
                                               : Vec3(5.0 * part(random), 1.0, 5.0 * part(random));
      const double dt_s = choice(random) < 90 ? kTickS : choice(random) * 1e-3;
      const Vec3 before_mm = PlaceOf(device);
      device.Write({{force_n}}, dt_s);
      const Vec3 p_mm = PlaceOf(device);
      EXPECT_TRUE(p_mm.allFinite()) << n;
      EXPECT_TRUE(((p_mm - spec.workspace_min_mm).array() >= -1e-9).all()) << n;
      EXPECT_TRUE(((spec.workspace_max_mm - p_mm).array() >= -1e-9).all()) << n;
      // What it is led at, and what the greatest force gives a hand with its damper.
      const double most_mm_s = kLedMmPerS + spec.max_force_n / kHandDamperNsPerMm + 100.0;
      const double moved_s = std::min(dt_s, kLongestMoveS);
      EXPECT_LE((p_mm - before_mm).norm(), most_mm_s * moved_s + 0.2) << n;
      places_mm.push_back(p_mm);
    }
    return places_mm;
  };
  const std::vector<Vec3> once = attack(), again = attack();
  for (std::size_t n = 0; n < once.size(); ++n) ASSERT_TRUE(SameBits(once[n], again[n])) << n;
}

TEST_F(LedTest, NeverAllocates) {
  MoveTo(Vec3(1.0, 2.0, 3.0));
  const std::uint64_t before = test::Allocations();
  for (int n = 0; n < 3000; ++n) {
    if (n % 16 == 0) MoveTo(OnCircle(n * kTickS));
    if (n == 2000) led_.GiveBack(lead_);
    device_.Write({{Vec3(0.1, 0.0, 0.0)}}, kTickS);
  }
  EXPECT_EQ(test::Allocations(), before);
}

TEST(LedScript, NeedsAnotherScript) {
  LedHand led;
  EXPECT_EQ(testing::Refusal([&] { LedScript(nullptr, led, Vec3::Zero(), Vec3::Ones()); }),
            ErrorKind::kInvalidArgument);
}

TEST(LedHand, HasOneLeaderAtATime) {
  LedHand led;
  EXPECT_EQ(led.led_by(), "");
  const LedHand::Lead ada = led.Take("ada");
  EXPECT_EQ(led.led_by(), "ada");
  EXPECT_FALSE(led.Newest().is_led);  // not before the first target
  led.MoveTo(ada, Vec3(1.0, 2.0, 3.0), 2);
  EXPECT_TRUE(led.Newest().is_led);
  try {
    led.Take("bob");
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kConflict);
    EXPECT_NE(std::string(error.what()).find("ada"), std::string::npos);
  }
  led.GiveBack(ada);
  EXPECT_FALSE(led.Newest().is_led);
  const LedHand::Lead bob = led.Take("bob");
  led.MoveTo(bob, Vec3(4.0, 5.0, 6.0), 0);
  // Who has given it back leads no more, and cannot give it back for another one.
  led.MoveTo(ada, Vec3(7.0, 8.0, 9.0), 0);
  led.GiveBack(ada);
  EXPECT_EQ(led.led_by(), "bob");
  EXPECT_EQ(led.Newest().x_mm, 4.0);
  for (const double strange : {kNan, kInfinity, -kInfinity}) {
    EXPECT_EQ(testing::Refusal([&] { led.MoveTo(bob, Vec3(0.0, strange, 0.0), 0); }),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(led.Newest().x_mm, 4.0);
}

}  // namespace
}  // namespace palpate
