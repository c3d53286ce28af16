// Whatever is computed, the force on the hand is finite, bounded and gradual.
#include "server/servo/safety.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace palpate {
namespace {

constexpr double kDtS = 1e-3;

TEST(Safety, LimitsRandomForces) {
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const SafetyLimits limits;
  Safety safety(limits);
  Vec3 last = Vec3::Zero();
  for (int n = 0; n < 1'000'000; ++n) {
    const double scale = std::pow(10.0, 300.0 * std::abs(uniform(random)) * (n % 3 == 0) - 1.0);
    const Vec3 wanted = scale * Vec3(uniform(random), uniform(random), uniform(random));
    const Vec3 force = safety.Limit(wanted, kDtS);
    ASSERT_TRUE(force.allFinite());
    ASSERT_LE(force.norm(), limits.max_force_n * (1 + 1e-12));
    ASSERT_LE((force - last).norm(), limits.max_slew_n_per_s * kDtS * (1 + 1e-9));
    last = force;
  }
  EXPECT_EQ(safety.faults(), 0u);
}

TEST(Safety, AForceThatIsNotFiniteCutsOffAtOnce) {
  Safety safety(SafetyLimits{});
  for (int n = 0; n < 10; ++n) safety.Limit(Vec3(1, 0, 0), kDtS);
  EXPECT_TRUE(safety.Limit(Vec3(std::numeric_limits<double>::quiet_NaN(), 0, 0), kDtS).isZero());
  EXPECT_EQ(safety.faults(), 1u);
  // And back gradually.
  EXPECT_NEAR(safety.Limit(Vec3(1, 0, 0), kDtS).norm(), 0.2, 1e-12);
}

TEST(Safety, ReachesAForceWithinTheLimits) {
  Safety safety(SafetyLimits{});
  Vec3 force = Vec3::Zero();
  for (int n = 0; n < 20; ++n) force = safety.Limit(Vec3(0.3, -1.2, 2.0), kDtS);
  EXPECT_NEAR((force - Vec3(0.3, -1.2, 2.0)).norm(), 0.0, 1e-12);
}

}  // namespace
}  // namespace palpate
