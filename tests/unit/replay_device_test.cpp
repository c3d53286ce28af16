#include "server/simulated_hand/replay_device.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/device_numbers.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using test::kNan;
using test::kTickS;
using testing::Refusal;

// State n is at x = n mm.
std::vector<DeviceState> Path(int states) {
  std::vector<DeviceState> path;
  for (int i = 0; i < states; ++i) {
    DeviceState state;
    state.p_MHip_mm = Vec3(i, -i, 0.5);
    state.R_MS = Eigen::AngleAxisd(0.1 * i, Vec3::UnitY());
    state.buttons = static_cast<std::uint32_t>(i);
    state.docked = i == 1;
    state.calibrated = i != 2;
    path.push_back(state);
  }
  return path;
}

double ReadX(ReplayDevice& device) {
  DeviceState state;
  EXPECT_EQ(device.Read(state), DeviceStatus::kOk);
  return state.p_MHip_mm.x();
}

std::vector<double> Play(ReplayDevice& device, int ticks, double dt_s) {
  std::vector<double> x_mm;
  for (int i = 0; i < ticks; ++i) {
    x_mm.push_back(ReadX(device));
    device.Write({}, dt_s);
  }
  return x_mm;
}

TEST(ReplayDevice, PlaysThereAndBackWithoutAJumpAndRestsInOneState) {
  ReplayDevice device(Path(4));
  device.Start();
  EXPECT_EQ(Play(device, 14, kTickS),
            (std::vector<double>{0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1}));
  ReplayDevice one(Path(1));
  EXPECT_FALSE(IsHardware(one.spec()));
  one.Start();
  EXPECT_EQ(Play(one, 5, kTickS), std::vector<double>(5, 0.0));
}

TEST(ReplayDevice, GivesAllOfAState) {
  ReplayDevice device(Path(4));
  device.Start();
  device.Write({}, kTickS);
  DeviceState state;
  ASSERT_EQ(device.Read(state), DeviceStatus::kOk);
  EXPECT_EQ(state.p_MHip_mm, Vec3(1, -1, 0.5));
  EXPECT_NEAR(state.R_MS.angularDistance(Path(4)[1].R_MS), 0.0, 1e-12);
  EXPECT_EQ(state.buttons, 1u);
  EXPECT_TRUE(state.docked);
  EXPECT_TRUE(state.calibrated);
  device.Write({}, kTickS);
  device.Read(state);
  EXPECT_FALSE(state.docked);
  EXPECT_FALSE(state.calibrated);
}

TEST(ReplayDevice, FollowsTheTimeAndNotTheTicks) {
  ReplayDevice device(Path(1000));
  device.Start();
  EXPECT_EQ(Play(device, 6, 0.0005), (std::vector<double>{0, 0, 1, 1, 2, 2}));
  EXPECT_EQ(Play(device, 3, 0.003), (std::vector<double>{3, 6, 9}));
}

TEST(ReplayDevice, AMillionTicksLoseNone) {
  ReplayDevice device(Path(501));
  device.Start();
  for (int i = 0; i < 1'000'000; ++i) device.Write({}, kTickS);
  EXPECT_EQ(ReadX(device), 0.0);
  device.Write({}, kTickS);
  EXPECT_EQ(ReadX(device), 1.0);
}

TEST(ReplayDevice, TimesThatAreNoneDoNotMoveIt) {
  ReplayDevice device(Path(1000));
  device.Start();
  for (const double dt_s : {0.0, -1.0, kNan, -test::kInfinity}) {
    device.Write({}, dt_s);
    EXPECT_EQ(ReadX(device), 0.0);
  }
  device.Write({}, test::kInfinity);
  EXPECT_EQ(ReadX(device), 20.0);
}

TEST(ReplayDevice, RemembersTheForceAndDoesNotYield) {
  ReplayDevice device(Path(10));
  device.Start();
  device.Write({{Vec3(1, 2, 3)}}, kTickS);
  EXPECT_EQ(device.last().wrench_M.force_n, Vec3(1, 2, 3));
  EXPECT_EQ(ReadX(device), 1.0);
  device.Write({{Vec3::Constant(kNan)}}, kTickS);
  EXPECT_EQ(ReadX(device), 2.0);
}

TEST(ReplayDevice, IsAtFaultUnlessStartedAndBeginsAgainAtTheBeginning) {
  ReplayDevice device(Path(10));
  DeviceState state;
  EXPECT_EQ(device.Read(state), DeviceStatus::kFault);
  device.Write({{Vec3(1, 0, 0)}}, kTickS);
  EXPECT_EQ(device.last().wrench_M.force_n, Vec3::Zero());
  device.Start();
  Play(device, 5, kTickS);
  device.Stop();
  device.Stop();
  EXPECT_EQ(device.Read(state), DeviceStatus::kFault);
  device.Start();
  EXPECT_EQ(ReadX(device), 0.0);
}

TEST(ReplayDevice, RefusesWhatIsNoPath) {
  std::vector<std::vector<DeviceState>> paths = {{}, Path(3), Path(3), Path(3)};
  paths[1][1].p_MHip_mm.z() = kNan;
  paths[2][2].R_MS.coeffs() *= 1.1;
  paths[3][2].R_MS.coeffs().setConstant(kNan);
  for (const std::vector<DeviceState>& path : paths) {
    EXPECT_EQ(Refusal([&] { ReplayDevice device(path); }), ErrorKind::kInvalidArgument);
  }
}

}  // namespace
}  // namespace palpate
