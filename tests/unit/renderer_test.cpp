// One haptic update: force, damping, bad input.
#include "server/haptics/renderer.h"

#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <vector>

#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr double kTickS = 1e-3;

class RendererTest : public ::testing::Test {
 protected:
  // Solid below z = 4.3 voxels of 0.5 mm: 2.15 mm.
  void SetUp() override {
    volume_ = testing::MakeVolume(Vec3i(9, 9, 9), [](int, int, int k) { return (8.0 - k) / 8.0; });
    surface_ =
        MakeHapticSurface(*volume_, {Mat3::Identity() * 0.5, Vec3::Zero()},
                          volume_->Normalize((8.0 - 4.3) / 8.0), DecompositionMethod::kTpbcc, 1);
    state_ = std::make_unique<RendererState>();
  }
  HapticOutput Step(const Vec3& hip) {
    return StepRenderer(surface_, settings_, hip, kTickS, *state_);
  }

  std::shared_ptr<const VolumeSnapshot> volume_;
  HapticSurface surface_;
  HapticSettings settings_{.stiffness_n_per_mm = 0.8, .damping_n_s_per_m = 0.0};
  std::unique_ptr<RendererState> state_;
};

TEST_F(RendererTest, ForceIsStiffnessTimesPenetration) {
  const HapticOutput free = Step(Vec3(2, 2, 3));
  EXPECT_TRUE(free.force_D_n.isZero());
  const HapticOutput output = Step(Vec3(2, 2, 1.15));
  EXPECT_NEAR((output.force_D_n - Vec3(0, 0, 0.8)).norm(), 0.0, 1e-6);
}

TEST_F(RendererTest, DampingOpposesApproachAndNeverPullsIn) {
  settings_.damping_n_s_per_m = 5.0;
  Step(Vec3(2, 2, 3));
  for (int n = 0; n < 10; ++n) Step(Vec3(2, 2, 2.1 - 0.02 * n));
  const HapticOutput in = Step(Vec3(2, 2, 1.9));
  EXPECT_GT(in.force_D_n.z(), 0.8 * 0.25);
  for (int n = 0; n < 40; ++n) {
    const HapticOutput out = Step(Vec3(2, 2, 1.9 + 0.006 * n));
    EXPECT_GE(out.force_D_n.z(), 0.0);
  }
}

// A low pass of 40 Hz: time constant 4 ms. A slower one would let the damper push on after
// the hand has stopped, a quicker one would follow the steps of the device's resolution.
TEST_F(RendererTest, TheVelocityFollowsTheHandInMilliseconds) {
  settings_.viscosity_n_s_per_m = 2.0;
  const double speed_mm_per_s = 20.0, settled_n = 2.0 * speed_mm_per_s * 1e-3;
  double x = 2.0;
  for (int n = 0; n < 50; ++n) Step(Vec3(x, 2, 3));
  std::vector<double> share;
  for (int n = 0; n < 10; ++n) {
    x += speed_mm_per_s * kTickS;
    share.push_back(Step(Vec3(x, 2, 3)).force_D_n.norm() / settled_n);
  }
  EXPECT_GT(share[3], 0.6);  // after 4 ms
  EXPECT_LT(share[3], 0.75);
  EXPECT_GT(share[9], 0.9);
}

TEST_F(RendererTest, InputThatIsNoPositionIsRejected) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  // Nothing is felt before the first position.
  const HapticOutput none = Step(Vec3::Constant(nan));
  EXPECT_TRUE(none.input_rejected);
  EXPECT_TRUE(none.force_D_n.isZero());
  Step(Vec3(2, 2, 3));
  const HapticOutput before = Step(Vec3(2, 2, 1.15));
  const double inf = std::numeric_limits<double>::infinity();
  for (const Vec3& bad : {Vec3(nan, 2, 1), Vec3(2, inf, 1), Vec3(2, 2, -1e300)}) {
    const HapticOutput output = Step(bad);
    EXPECT_TRUE(output.input_rejected);
    EXPECT_EQ(output.p_DHip_mm, Vec3(2, 2, 1.15));
    EXPECT_EQ(output.proxy.p_DH_mm, before.proxy.p_DH_mm);
    EXPECT_TRUE(output.force_D_n.allFinite());
  }
}

}  // namespace
}  // namespace palpate
