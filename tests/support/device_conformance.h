// What every device promises, whatever its kind: told once, and asked of each kind on its emulator.
// What one kind alone does, its own test has. Instantiated in device_conformance_test, and in
// device_threads_test, which ThreadSanitizer judges.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <thread>

#include "server/device/stream/device_link.h"
#include "tests/support/patience.h"
#include "tests/support/served_device.h"

namespace palpate::test {

template <class Rig>
class DeviceConformance : public ::testing::Test {};

TYPED_TEST_SUITE_P(DeviceConformance);

// A plane on each side of the stylus, 1 mm away, of 0.5 N/mm: the hand goes 2 mm into it.
TYPED_TEST_P(DeviceConformance, EachAxisIsReadAndPushedTheRightWay) {
  TypeParam rig;
  rig.Make();
  for (int n = 0; n < 6; ++n) {
    Vec3 into = Vec3::Zero();
    into[n / 2] = n % 2 == 0 ? 1.0 : -1.0;
    const Vec3 place_mm = rig.kRest + 3.0 * into;
    rig.Place(place_mm);
    const auto plane = [&](const DeviceState& state) {
      const double depth_mm = (state.p_MHip_mm - rig.kRest).dot(into) - 1.0;
      return Wrench{.force_n = -0.5 * std::max(depth_mm, 0.0) * into};
    };
    EXPECT_TRUE(
        rig.device_->Serve(plane, [&] { return (rig.Felt_n() + into).norm() < rig.kForceN; }))
        << into.transpose() << ", felt " << rig.Felt_n().transpose();
    EXPECT_LT((rig.device_->state().p_MHip_mm - place_mm).norm(), rig.kPlaceMm);
  }
}

// The share judges, and not the clock. Rounds in which this machine stood still do not count: a
// reading was old, and the forces off. Of a bus that streams, several readings come at once then.
TYPED_TEST_P(DeviceConformance, EachReadingIsAnsweredByAForce) {
  TypeParam rig;
  rig.Make();
  ASSERT_TRUE(rig.Pushes());
  DeviceTally before = rig.Tally();
  double readings = 0.0, forces = 0.0;
  bool was_old = false;
  ASSERT_TRUE(rig.device_->Serve(kPush, [&] {
    was_old |= rig.device_->status() != DeviceStatus::kOk;
    const DeviceTally now = rig.Tally();
    if (now.readings < before.readings + 25) return false;
    if (!was_old) {
      readings += static_cast<double>(now.readings - before.readings);
      forces += static_cast<double>(now.forces - before.forces);
    }
    before = now;
    was_old = false;
    return readings >= 2000.0;
  }));
  std::printf("%.4f forces for each reading\n", forces / readings);
  EXPECT_NEAR(forces / readings, 1.0, 0.05);
  EXPECT_EQ(rig.device_->health().corrupt_frames, 0u);
}

TYPED_TEST_P(DeviceConformance, ItsMotorsHaveNoCurrentUntilTheyMay) {
  TypeParam rig;
  rig.Make();
  ServedDevice& device = *rig.device_;
  for (const bool has_begun : {false, true}) {
    if (has_begun) {
      rig.Place(rig.kRest);
      EXPECT_TRUE(device.ServeUntil(DeviceStatus::kOk));
    }
    const std::uint64_t before = device.health().readings;
    EXPECT_TRUE(Eventually([&] {
      if (has_begun) device->Write({.wrench_M = kPush, .motors_on = false}, 0.001);
      return device.health().readings > before + 50;
    }));
    EXPECT_EQ(rig.Tally().pushes, 0u);
    EXPECT_TRUE(rig.IsLetGoOf() && (has_begun || device.health().watchdog_zeros == 0));
  }
}

// A servo that resumes with its old force would kick the hand.
TYPED_TEST_P(DeviceConformance, ASilentServoEndsTheForceAndNoOldForceComesBack) {
  TypeParam rig;
  rig.Make();
  ServedDevice& device = *rig.device_;
  const auto readings = [&] { return device.health().readings; };
  for (int n = 0; n < 3; ++n) {
    ASSERT_TRUE(rig.Pushes());
    const std::uint64_t zeros = device.health().watchdog_zeros;
    EXPECT_TRUE(
        Eventually([&] { return device.health().watchdog_zeros > zeros && rig.IsLetGoOf(); }));
    const std::uint64_t pushes = rig.Tally().pushes, before = readings();
    EXPECT_TRUE(Eventually([&] {
      DeviceState state;
      device->Write({.wrench_M = kPush, .motors_on = true}, 0.001);
      EXPECT_NE(device->Read(state), DeviceStatus::kOk);
      return readings() > before + 50;
    }));
    EXPECT_EQ(rig.Tally().pushes, pushes);  // until zero is written
    EXPECT_TRUE(rig.IsLetGoOf());
  }
  EXPECT_TRUE(rig.Pushes());
}

TYPED_TEST_P(DeviceConformance, IsLookedForUntilItIsPluggedInAndAgainWhenItIsPulledOut) {
  TypeParam rig;
  rig.Unplug();
  rig.Make();
  ServedDevice& device = *rig.device_;
  EXPECT_TRUE(device.HasProblem(rig.kAbsent)) << device.health().problem;
  EXPECT_TRUE(device.ServeUntil(DeviceStatus::kFault));
  for (std::uint64_t connections = 0, n = 0; n < 3; ++n) {
    EXPECT_EQ(device.health().connection, DeviceConnection::kAbsent);
    // Time for further tries, which are no news. If it was silent just before, it is not found.
    std::this_thread::sleep_for(2 * DeviceLink::kRetry);
    EXPECT_EQ(device.CountLines(rig.kLost) + device.CountLines(rig.kAbsent),
              n == 0 ? 1 : rig.kLinesOfALoss)
        << device.log();
    rig.Plug();
    ASSERT_TRUE(device.Streams());
    EXPECT_FALSE(rig.kForgetsItsPlace && device.health().calibrated);
    ASSERT_TRUE(rig.Pushes());
    EXPECT_EQ(device.health().problem, "");
    EXPECT_GT(device.health().connections, connections);
    connections = device.health().connections;
    device.Forget();
    rig.Unplug();
    EXPECT_TRUE(device.Serve(kPush, [&] {
      return device.status() == DeviceStatus::kFault &&
             device.health().connection == DeviceConnection::kAbsent;
    }));
    EXPECT_TRUE(Eventually([&] { return rig.IsLetGoOf(); }));
  }
}

TYPED_TEST_P(DeviceConformance, ADeviceThatFallsSilentIsAFaultWithoutForceAndComesBack) {
  TypeParam rig;
  rig.Make();
  ServedDevice& device = *rig.device_;
  for (int n = 0; n < 2; ++n) {
    ASSERT_TRUE(rig.Pushes());
    device.Forget();
    const std::uint64_t connections = device.health().connections;
    rig.SetSilent(true);
    EXPECT_TRUE(device.Serve(kPush, [&] { return device.status() == DeviceStatus::kFault; }));
    EXPECT_TRUE(device.Logs(rig.kSilent)) << device.log();
    EXPECT_TRUE(Eventually([&] { return rig.IsLetGoOf(); }));
    rig.SetSilent(false);
    ASSERT_TRUE(rig.Pushes());
    EXPECT_GT(device.health().connections, connections);
  }
}

TYPED_TEST_P(DeviceConformance, WhatCannotBeOpenedIsExplainedAndLeftAlone) {
  TypeParam rig;
  for (const Hindrance& one : rig.Hindrances()) {
    SCOPED_TRACE(one.told.front());
    rig.device_.reset();
    const std::uint64_t touches = rig.Touches();
    one.make();
    for (const std::string& part : one.told) {
      EXPECT_TRUE(rig.device_->HasProblem(part)) << rig.device_->health().problem;
    }
    EXPECT_TRUE(rig.device_->ServeUntil(DeviceStatus::kFault));
    EXPECT_EQ(rig.Touches(), touches);
    one.undo();
    EXPECT_TRUE(!one.comes_by_itself || rig.Pushes()) << rig.device_->health().problem;
  }
  rig.Make();
  EXPECT_TRUE(rig.Pushes());
}

TYPED_TEST_P(DeviceConformance, OfTwoTheSerialNumberChooses) {
  TypeParam rig;
  rig.PlugOther();
  if (const char* both = TypeParam::kBoth) {
    rig.Make();
    EXPECT_TRUE(rig.device_->HasProblem(both)) << rig.device_->health().problem;
  }
  rig.Make(rig.kOther);
  ASSERT_TRUE(rig.device_->Streams());
  EXPECT_TRUE(rig.device_->Logs(rig.kOther)) << rig.device_->log();
  EXPECT_TRUE(Eventually([&] { return rig.IsOtherDriven(); }));
  EXPECT_FALSE(rig.IsTouched());
  rig.Make(rig.kOwn);
  EXPECT_TRUE(rig.Pushes());
}

REGISTER_TYPED_TEST_SUITE_P(DeviceConformance, EachAxisIsReadAndPushedTheRightWay,
                            EachReadingIsAnsweredByAForce, ItsMotorsHaveNoCurrentUntilTheyMay,
                            ASilentServoEndsTheForceAndNoOldForceComesBack,
                            IsLookedForUntilItIsPluggedInAndAgainWhenItIsPulledOut,
                            ADeviceThatFallsSilentIsAFaultWithoutForceAndComesBack,
                            WhatCannotBeOpenedIsExplainedAndLeftAlone, OfTwoTheSerialNumberChooses);

}  // namespace palpate::test
