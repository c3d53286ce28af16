#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/fixed_scripts.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/device_numbers.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using test::kInfinity;
using test::kNan;
using test::kTickS;
using test::SameBits;

using Surface = std::function<Vec3(const Vec3&)>;  // position in mm to force in N

Vec3 Nothing(const Vec3&) { return Vec3::Zero(); }

// A solid ball: the proxy is on its surface, right outside the stylus.
Surface Sphere(const Vec3& centre_mm, double radius_mm, double stiffness_n_per_mm) {
  return [=](const Vec3& p_mm) -> Vec3 {
    const Vec3 out_mm = p_mm - centre_mm;
    const double depth_mm = radius_mm - out_mm.norm();
    if (depth_mm <= 0.0) return Vec3::Zero();
    return out_mm.normalized() * (stiffness_n_per_mm * depth_mm);
  };
}

// A solid half-space below a plane.
Surface Plane(const Vec3& point_mm, const Vec3& normal, double stiffness_n_per_mm) {
  return [=, unit = Vec3(normal.normalized())](const Vec3& p_mm) -> Vec3 {
    const double depth_mm = unit.dot(point_mm - p_mm);
    return depth_mm <= 0.0 ? Vec3::Zero() : Vec3(unit * (stiffness_n_per_mm * depth_mm));
  };
}

// A solid box: the proxy is on the nearest of its sides.
Surface Box(const Vec3& centre_mm, const Vec3& half_mm, double stiffness_n_per_mm) {
  return [=](const Vec3& p_mm) -> Vec3 {
    const Vec3 out_mm = p_mm - centre_mm;
    Eigen::Index axis = 0;
    const double depth_mm = (half_mm - out_mm.cwiseAbs()).minCoeff(&axis);
    if (depth_mm <= 0.0) return Vec3::Zero();
    const double side = out_mm[axis] < 0.0 ? -1.0 : 1.0;
    return Vec3::Unit(axis) * (side * stiffness_n_per_mm * depth_mm);
  };
}

std::unique_ptr<SimulatedDevice> Exploring(std::uint64_t seed) {
  const DeviceDescription spec = SimulatedDeviceSpec();
  auto device = std::make_unique<SimulatedDevice>(
      std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, seed));
  device->Start();
  return device;
}

std::unique_ptr<SimulatedDevice> Following(std::vector<Vec3> waypoints_mm, double speed_mm_s) {
  auto device = std::make_unique<SimulatedDevice>(
      std::make_unique<PathScript>(std::move(waypoints_mm), speed_mm_s));
  device->Start();
  return device;
}

DeviceState ReadOk(SimulatedDevice& device) {
  DeviceState state;
  EXPECT_EQ(device.Read(state), DeviceStatus::kOk);
  return state;
}

struct Tick {
  DeviceState state;
  Vec3 force_n;
};

// The loop of the servo: a force from the newest reading, and, as a worst case,
// a tick late.
std::vector<Tick> Loop(SimulatedDevice& device, const Surface& surface, int ticks,
                       bool tick_late = false) {
  std::vector<Tick> log;
  log.reserve(static_cast<std::size_t>(ticks));
  Vec3 last_n = Vec3::Zero();
  for (int i = 0; i < ticks; ++i) {
    const DeviceState state = ReadOk(device);
    const Vec3 force_n = surface(state.p_MHip_mm);
    log.push_back({state, tick_late ? last_n : force_n});
    device.Write({{log.back().force_n}}, kTickS);
    last_n = force_n;
  }
  return log;
}

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

// What a run felt like, after its first two seconds.
struct Feel {
  double contact_share = 0.0;
  double contacts_per_s = 0.0;     // from no force to force
  double median_speed_mm_s = 0.0;  // these in contact, over 50 ms
  double slow_speed_mm_s = 0.0;    // 10 % are slower
  double fast_speed_mm_s = 0.0;    // 10 % are faster
  double median_force_n = 0.0;
  double median_buzz_n = 0.0;  // deviation of the force from its mean over 50 ms
};

Feel Felt(const std::vector<Tick>& log) {
  constexpr std::size_t kFrom = 2000;
  constexpr std::size_t kWindow = 50;
  Feel feel;
  std::vector<double> speeds, forces, buzz;
  for (std::size_t i = kFrom; i < log.size(); ++i) {
    const bool touches = log[i].force_n.norm() > 0.0;
    if (touches) forces.push_back(log[i].force_n.norm());
    feel.contacts_per_s += touches && log[i - 1].force_n.norm() == 0.0;
    if (i < kFrom + kWindow || (i - kFrom) % kWindow != 0) continue;
    double mean_n = 0.0, square_n2 = 0.0;
    bool all = true;
    for (std::size_t j = i - kWindow; j < i; ++j) {
      const double force_n = log[j].force_n.norm();
      all = all && force_n > 0.0;
      mean_n += force_n / kWindow;
      square_n2 += force_n * force_n / kWindow;
    }
    if (!all) continue;
    const Vec3 moved_mm = log[i].state.p_MHip_mm - log[i - kWindow].state.p_MHip_mm;
    speeds.push_back(moved_mm.norm() / (kWindow * kTickS));
    buzz.push_back(std::sqrt(std::max(0.0, square_n2 - mean_n * mean_n)));
  }
  const double ticks = static_cast<double>(log.size() - kFrom);
  feel.contact_share = static_cast<double>(forces.size()) / ticks;
  feel.contacts_per_s /= ticks * kTickS;
  feel.median_speed_mm_s = Quantile(speeds, 0.5);
  feel.slow_speed_mm_s = Quantile(speeds, 0.1);
  feel.fast_speed_mm_s = Quantile(speeds, 0.9);
  feel.median_force_n = Quantile(forces, 0.5);
  feel.median_buzz_n = Quantile(buzz, 0.5);
  return feel;
}

void ExpectExploresWell(const Feel& feel) {
  EXPECT_GE(feel.contact_share, 0.6);
  EXPECT_LE(feel.contacts_per_s, 5.0);
  EXPECT_GE(feel.slow_speed_mm_s, 30.0);
  EXPECT_LE(feel.fast_speed_mm_s, 150.0);
  EXPECT_GE(feel.median_force_n, 0.3);
  EXPECT_LE(feel.median_force_n, 1.2);
  EXPECT_LE(feel.median_buzz_n, 0.1);
}

TEST(SimulatedDevice, AnswersBetweenStartAndStopOnly) {
  EXPECT_THROW(SimulatedDevice(nullptr), Error);
  SimulatedDevice device(std::make_unique<PathScript>(std::vector<Vec3>{Vec3::Zero()}, 10.0));
  EXPECT_FALSE(IsHardware(device.spec()));
  DeviceState state;
  EXPECT_EQ(device.Read(state), DeviceStatus::kFault);
  device.Start();
  EXPECT_EQ(device.Read(state), DeviceStatus::kOk);
  device.Stop();
  device.Stop();
  device.Write({{Vec3(1.0, 0.0, 0.0)}}, kTickS);
  EXPECT_EQ(device.Read(state), DeviceStatus::kFault);
}

TEST(SimulatedDevice, ReadsInStepsOfItsResolution) {
  const auto device = Following({Vec3(-30.0, 10.0, 0.0), Vec3(40.0, -20.0, 13.0)}, 37.0);
  const DeviceDescription& spec = device->spec();
  for (const Tick& tick : Loop(*device, Nothing, 3000)) {
    for (int i = 0; i < 3; ++i) {
      const double counts = (tick.state.p_MHip_mm[i] - spec.workspace_min_mm[i]) / 0.055;
      ASSERT_NEAR(counts, std::round(counts), 1e-6);
    }
  }
}

TEST(SimulatedDevice, TheHandFollowsItsPathAndComesRound) {
  const Vec3 a_mm(-20.0, 0.0, 0.0), b_mm(20.0, 0.0, 0.0);
  const auto device = Following({a_mm, b_mm}, 40.0);
  EXPECT_LT((ReadOk(*device).p_MHip_mm - a_mm).norm(), 0.1);
  Loop(*device, Nothing, 500);
  // Half way, behind the target by damper * speed / spring = 1.6 mm.
  EXPECT_NEAR(ReadOk(*device).p_MHip_mm.x(), -1.6, 0.2);
  Loop(*device, Nothing, 500);
  EXPECT_LT((ReadOk(*device).p_MHip_mm - b_mm).norm(), 2.0);
  Loop(*device, Nothing, 1000);
  EXPECT_LT((ReadOk(*device).p_MHip_mm - a_mm).norm(), 2.0);
}

TEST(SimulatedDevice, AForceMovesTheHandAndItComesBack) {
  const auto device = Following({Vec3::Zero()}, 10.0);
  const Vec3 force_n(0.3, -0.6, 0.0);
  Loop(
      *device, [&](const Vec3&) { return force_n; }, 1000);
  EXPECT_LT((ReadOk(*device).p_MHip_mm - force_n / kHandSpringNPerMm).norm(), 0.1);
  Loop(*device, Nothing, 1000);
  EXPECT_LT(ReadOk(*device).p_MHip_mm.norm(), 0.1);
}

TEST(SimulatedDevice, RestsOnStiffSurfaces) {
  for (const double stiffness_n_per_mm : {0.5, 1.0, 3.0}) {
    for (const bool tick_late : {false, true}) {
      // The target is 4 mm under the surface: 1.2 N at most.
      const auto device =
          Following({Vec3(0.0, 0.0, 2.0), Vec3(0.0, 0.0, -4.0), Vec3(0.0, 0.0, -4.0),
                     Vec3(20.0, 0.0, -4.0), Vec3(-20.0, 0.0, -4.0)},
                    20.0);
      const Surface plane = Plane(Vec3::Zero(), Vec3::UnitZ(), stiffness_n_per_mm);
      std::vector<double> forces_n;
      Loop(*device, plane, 800, tick_late);
      for (const Tick& tick : Loop(*device, plane, 1000, tick_late)) {
        forces_n.push_back(tick.force_n.norm());
      }
      const double expected_n = 4.0 / (1.0 / kHandSpringNPerMm + 1.0 / stiffness_n_per_mm);
      EXPECT_NEAR(Quantile(forces_n, 0.5), expected_n, 0.15);
      // No more than a few steps of the resolution.
      EXPECT_LE(Quantile(forces_n, 0.99) - Quantile(forces_n, 0.01),
                4.0 * 0.055 * stiffness_n_per_mm)
          << stiffness_n_per_mm << " N/mm, late: " << tick_late;
    }
  }
}

TEST(SimulatedDevice, StaysInItsWorkspaceAndFiniteWhateverIsWritten) {
  const auto device = Exploring(3);
  const DeviceDescription& spec = device->spec();
  const std::vector<double> values = {0.0, 1.0, -3.3, 1e6, -1e300, kInfinity, -kInfinity, kNan};
  const std::vector<double> times_s = {kTickS, 0.0, -1.0, 1e-9, 0.0075, 10.0, kInfinity, kNan};
  for (std::size_t i = 0; i < 20'000; ++i) {
    const auto value = [&](std::size_t shift) { return values[(i / shift) % values.size()]; };
    const double dt_s = i % 3 == 0 ? times_s[(i / 3) % times_s.size()] : kTickS;
    device->Write({{Vec3(value(1), value(7), value(50))}}, dt_s);
    const DeviceState state = ReadOk(*device);
    ASSERT_TRUE(state.p_MHip_mm.allFinite());
    ASSERT_TRUE((state.p_MHip_mm.array() >= spec.workspace_min_mm.array()).all());
    ASSERT_TRUE((state.p_MHip_mm.array() <= spec.workspace_max_mm.array()).all());
    ASSERT_NEAR(state.R_MS.norm(), 1.0, 1e-9);
  }
}

TEST(SimulatedDevice, ReachesItsStopsAndLeavesThem) {
  const auto device = Following({Vec3::Zero()}, 10.0);
  // The peak force holds against 11 mm of the hand's spring, no more.
  Loop(
      *device, [](const Vec3&) { return Vec3(1e9, 0.0, 0.0); }, 1000);
  EXPECT_NEAR(ReadOk(*device).p_MHip_mm.x(), 3.3 / kHandSpringNPerMm, 0.1);

  const auto outside = Following({Vec3(200.0, 0.0, 0.0), Vec3::Zero()}, 200.0);
  EXPECT_NEAR(ReadOk(*outside).p_MHip_mm.x(), 80.0, 0.06);
  Loop(*outside, Nothing, 1000);
  EXPECT_LT(ReadOk(*outside).p_MHip_mm.x(), 10.0);
}

TEST(SimulatedDevice, AForceThatIsNotANumberCountsAsNone) {
  const auto one = Exploring(5);
  const auto other = Exploring(5);
  for (int i = 0; i < 2000; ++i) {
    one->Write({{Vec3(kNan, 1.0, 1.0)}}, kTickS);
    other->Write({}, kTickS);
    ASSERT_TRUE(SameBits(ReadOk(*one).p_MHip_mm, ReadOk(*other).p_MHip_mm));
  }
}

// What the hand feels is its script's.
TEST(SimulatedDevice, HasATorqueIfItIsToldSo) {
  struct Felt final : StylusScript {
    explicit Felt(Wrench& felt) : felt_(felt) {}
    Target Next(const HandState&, const Wrench& felt_M, double) noexcept override {
      felt_ = felt_M;
      return {};
    }
    Wrench& felt_;
  };
  for (const double most_n_mm : {0.0, 50.0}) {
    Wrench felt;
    SimulatedDevice device(std::make_unique<Felt>(felt), SimulatedDeviceSpec(most_n_mm));
    EXPECT_EQ(device.spec().max_torque_n_mm, most_n_mm);
    device.Start();
    device.Write({.wrench_M = {Vec3(0, 9, 0), Vec3(0, 0, 300)}}, kTickS);
    EXPECT_TRUE(felt.force_n.isApprox(Vec3(0, 3.3, 0)));
    EXPECT_EQ(felt.torque_n_mm, Vec3(0, 0, most_n_mm));
    device.Write({.wrench_M = {Vec3::Zero(), Vec3(kNan, 1, 0)}}, kTickS);
    EXPECT_EQ(felt.torque_n_mm, Vec3::Zero());
  }
}

// A spring of 500 N mm for a radian, which comes to rest.
TEST(SimulatedDevice, ATorqueTurnsTheWrist) {
  struct Held final : StylusScript {
    Target Next(const HandState&, const Wrench&, double) noexcept override {
      return {.is_turned = true};
    }
  };
  SimulatedDevice device(std::make_unique<Held>(), SimulatedDeviceSpec(100.0));
  device.Start();
  const auto turn_after = [&](const Vec3& torque_n_mm) {
    for (int n = 0; n < 1000; ++n) device.Write({.wrench_M = {Vec3::Zero(), torque_n_mm}}, kTickS);
    const Eigen::AngleAxisd turn(ReadOk(device).R_MS);
    return Vec3(turn.angle() * turn.axis());
  };
  EXPECT_LT((turn_after(Vec3(0, 50, 0)) - Vec3(0, 0.1, 0)).norm(), 1e-4);
  EXPECT_LT((turn_after(Vec3(-300, 0, 0)) - Vec3(-0.2, 0, 0)).norm(), 1e-4);  // saturates
  EXPECT_LT(turn_after(Vec3::Zero()).norm(), 1e-4);
}

TEST(SimulatedDevice, SameInputSameBits) {
  const Surface sphere = Sphere(Vec3::Zero(), 25.0, 0.5);
  const auto one = Exploring(11);
  const auto again = Exploring(11);
  const auto other_seed = Exploring(12);
  const std::vector<Tick> a = Loop(*one, sphere, 8000);
  const std::vector<Tick> b = Loop(*again, sphere, 8000);
  const std::vector<Tick> c = Loop(*other_seed, sphere, 8000);
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_TRUE(SameBits(a[i].state.p_MHip_mm, b[i].state.p_MHip_mm)) << i;
    ASSERT_TRUE(SameBits(a[i].state.R_MS.vec(), b[i].state.R_MS.vec())) << i;
  }
  EXPECT_FALSE(SameBits(a.back().state.p_MHip_mm, c.back().state.p_MHip_mm));
}

TEST(SimulatedDevice, TheStylusTurnsSlowlyAndSmoothly) {
  const auto device = Exploring(2);
  const std::vector<Tick> log = Loop(*device, Sphere(Vec3::Zero(), 25.0, 0.5), 10'000);
  double largest_rad = 0.0;
  for (std::size_t i = 1; i < log.size(); ++i) {
    const Eigen::Quaterniond& before = log[i - 1].state.R_MS;
    const Eigen::Quaterniond& now = log[i].state.R_MS;
    ASSERT_NEAR(now.norm(), 1.0, 1e-9);
    ASSERT_GT(now.dot(before), 0.0);
    ASSERT_LT(now.angularDistance(before), 0.01);  // 10 rad/s
    largest_rad = std::max(largest_rad, now.angularDistance(log[0].state.R_MS));
    // The barrel stays towards the user and above the tip.
    const Vec3 barrel = now * Vec3::UnitZ();
    ASSERT_GT(barrel.z(), 0.0);
    ASSERT_GT(barrel.y(), 0.0);
  }
  EXPECT_GT(largest_rad, 0.05);
}

// Eight in the long form: each feels for 20 s.
std::uint64_t Seeds() { return static_cast<std::uint64_t>(std::min(test::Scaled(2), 8)); }

// Ticks until it touches; `longest`: it does not.
int SearchMs(SimulatedDevice& device, const Surface& surface, int longest) {
  int search_ms = 0;
  while (search_ms < longest && Loop(device, surface, 1).back().force_n.isZero()) ++search_ms;
  return search_ms;
}

TEST(Explore, FindsWhatIsRoundOrFlatAndSlidesOverIt) {
  const Surface sphere = Sphere(Vec3::Zero(), 25.0, 0.5);
  const Surface plane = Plane(Vec3(0.0, 0.0, -5.0), Vec3(0.2, 0.1, 1.0), 0.5);
  for (std::uint64_t seed = 1; seed <= Seeds(); ++seed) {
    SCOPED_TRACE(seed);
    ExpectExploresWell(Felt(Loop(*Exploring(seed), sphere, 20'000)));
    // A plane can be missed for a while by seeks along it: what counts is how it is felt then.
    const auto device = Exploring(seed);
    EXPECT_LT(SearchMs(*device, plane, 20'000), 20'000);
    ExpectExploresWell(Felt(Loop(*device, plane, 20'000)));
  }
  // A stiffer one that answers a tick late.
  ExpectExploresWell(
      Felt(Loop(*Exploring(4), Sphere(Vec3(5.0, -8.0, 2.0), 25.0, 1.0), 20'000, true)));
}

// From these it slips off all the time, and comes back.
TEST(Explore, KeepsToThingsThatAreSmallOrHaveSharpEdges) {
  for (std::uint64_t seed = 1; seed <= Seeds(); ++seed) {
    SCOPED_TRACE(seed);
    const Surface box = Box(Vec3(6.0, -9.0, 4.0), Vec3(20.0, 10.0, 6.0), 0.5);
    const Feel edges = Felt(Loop(*Exploring(seed), box, 20'000));
    EXPECT_GE(edges.contact_share, 0.6);
    EXPECT_GE(edges.median_speed_mm_s, 30.0);
    EXPECT_LE(edges.fast_speed_mm_s, 150.0);
    EXPECT_LE(edges.median_buzz_n, 0.1);
    const Surface grain = Sphere(Vec3(3.0, 2.0, -4.0), 5.0, 0.5);
    const Feel small = Felt(Loop(*Exploring(seed), grain, 20'000));
    EXPECT_GE(small.contact_share, 0.6);
    EXPECT_LE(small.median_buzz_n, 0.1);
  }
}

TEST(Explore, FindsWhatIsInTheMiddleAtOnce) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    EXPECT_LT(SearchMs(*Exploring(seed), Sphere(Vec3::Zero(), 10.0, 0.5), 1000), 1000) << seed;
  }
}

TEST(Explore, LooksEverywhereWhenThereIsNothing) {
  const auto device = Exploring(9);
  const std::vector<Tick> log = Loop(*device, Nothing, 60'000);
  Eigen::AlignedBox3d seen;
  for (const Tick& tick : log) seen.extend(tick.state.p_MHip_mm);
  const Vec3 share = seen.sizes().cwiseQuotient(Vec3(160.0, 120.0, 70.0));
  EXPECT_GT(share.minCoeff(), 0.5);
}

TEST(Explore, SeeksAgainWhenTheSurfaceGoesAway) {
  const auto device = Exploring(6);
  const Surface sphere = Sphere(Vec3::Zero(), 25.0, 0.5);
  Loop(*device, sphere, 5000);
  Loop(*device, Nothing, 3000);
  ExpectExploresWell(Felt(Loop(*device, sphere, 20'000)));
}

}  // namespace
}  // namespace palpate
