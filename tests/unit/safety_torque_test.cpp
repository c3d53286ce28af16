// What the safety stage does with a torque alone. All tests of safety_test.cpp ask that the torque
// does what the force does.
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "server/safety/safety.h"
#include "tests/support/device_numbers.h"

namespace palpate::safety_torque {
namespace {

using test::kInfinity;
using test::kNan;

constexpr double kDtS = 1e-3;
const Vec3 kPush_n(0.3, -1.2, 2.0);

DeviceDescription Hardware() {
  DeviceDescription spec;
  spec.kind = "fake";
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

TEST(SafetyTorque, IsClampedByItself) {
  SafetyLimits limits;
  limits.max_torque_n_mm = 50.0;
  Safety safety(limits);
  Wrench wrench;
  const SafetyInput input{.wrench_D = {Vec3(1, 0, 0), Vec3(0, 1e308, 0)}};
  for (int n = 0; n < 16; ++n) {
    const Vec3 last_n_mm = wrench.torque_n_mm;
    wrench = safety.Step(input, kDtS);
    EXPECT_NEAR((wrench.torque_n_mm - last_n_mm).norm(), 3.0, 1e-9);  // 3000 N mm/s
  }
  wrench = safety.Step(input, kDtS);
  EXPECT_NEAR(wrench.torque_n_mm.y(), 50.0, 1e-9);
  EXPECT_EQ(wrench.force_n, Vec3(1, 0, 0));
}

TEST(SafetyTorque, HardwareIsWarmedByItAlone) {
  DeviceDescription spec = Hardware();
  spec.max_torque_n_mm = 400.0;  // more than any device gets at first
  spec.continuous_torque_n_mm = 12.0;
  Safety safety(LimitsFor(spec, 0));
  EXPECT_EQ(safety.torque_limit_n_mm(), 50.0);
  SafetyInput input{.wrench_D = {Vec3(0.1, 0, 0), Vec3(0, 0, 50)},
                    .command = ForceCommand::kEnable};
  for (int n = 0; n < 60'000; ++n) safety.Step(input, kDtS);
  EXPECT_NEAR(safety.torque_limit_n_mm(), 12.0, 0.1);
  EXPECT_EQ(safety.limit_n(), 3.3);
}

// Each with the whole wrench in one tick, and only of a device that has a torque.
TEST(SafetyTorque, FaultsOfTurningCutTheWholeWrench) {
  struct Case {
    ForceReason reason;
    std::function<void(SafetyInput&)> make;
  };
  const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.5, Vec3::UnitY()));
  const std::vector<Case> cases = {
      {ForceReason::kForce, [](SafetyInput& in) { in.wrench_D.torque_n_mm.y() = kNan; }},
      {ForceReason::kForce, [](SafetyInput& in) { in.wrench_D.torque_n_mm.z() = -kInfinity; }},
      {ForceReason::kPosition, [](SafetyInput& in) { in.R_DS.coeffs() *= 1.01; }},
      {ForceReason::kPosition, [](SafetyInput& in) { in.R_DS.x() = kNan; }},
      {ForceReason::kSpeed, [&](SafetyInput& in) { in.R_DS = turned; }}};
  for (const double torque_n_mm : {50.0, 0.0}) {
    DeviceDescription spec = Hardware();
    spec.max_torque_n_mm = torque_n_mm;
    for (const Case& one : cases) {
      SCOPED_TRACE(static_cast<int>(one.reason));
      Safety safety(LimitsFor(spec, 0));
      SafetyInput input{.wrench_D = {kPush_n, Vec3(0, 5, 0)}, .command = ForceCommand::kEnable};
      Wrench wrench;
      for (int n = 0; n < 600; ++n) {
        wrench = safety.Step(input, kDtS);
        input.command = ForceCommand::kNone;
      }
      ASSERT_LT((wrench.force_n - kPush_n).norm(), 1e-9);
      EXPECT_EQ(wrench.torque_n_mm.isZero(0.0), torque_n_mm == 0.0);
      one.make(input);
      wrench = safety.Step(input, kDtS);
      const bool judged = torque_n_mm > 0.0;
      EXPECT_EQ(wrench.is_zero(), judged);
      EXPECT_TRUE(wrench.allFinite());
      EXPECT_EQ(safety.reason(), judged ? one.reason : ForceReason::kNone);
    }
  }
}

}  // namespace
}  // namespace palpate::safety_torque
