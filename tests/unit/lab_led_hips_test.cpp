// A hand that is led along a trajectory, without a daemon.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/error/error.h"
#include "server/lab/led_hips.h"
#include "server/lab/replay.h"
#include "tests/support/made_volume.h"

namespace palpate::lab {
namespace {

constexpr double kSpringNPerMm = 0.3;     // of the hand
constexpr double kResolutionMm = 0.055;   // of the device
constexpr double kStiffnessNPerMm = 0.6;  // of the surface

// Material from x = 10 on; the surface is at x = 9.5.
class LabLedHips : public ::testing::Test {
 protected:
  // Straight to x mm in as many ticks, and at rest there for as many.
  static std::vector<Vec3> To(double x_mm, int ticks) {
    std::vector<Vec3> targets_mm;
    for (int n = 0; n < 2 * ticks; ++n) {
      const double share = std::min(1.0, static_cast<double>(n) / ticks);
      targets_mm.emplace_back(2.0 + share * (x_mm - 2.0), 10.0, 10.0);
    }
    return targets_mm;
  }

  const std::shared_ptr<const VolumeSnapshot> volume_ =
      testing::MakeVolume(Vec3i::Constant(20), [](int i, int, int) { return i >= 10 ? 1.0 : 0.0; });
  const HapticSurface surface_ =
      MakeHapticSurface(*volume_, volume_->metadata().WorldFromIndex(), 0.5,
                        DecompositionMethod::kTpbcc, 1, FreeSide::kBelow);
  const HapticSettings settings_{.stiffness_n_per_mm = kStiffnessNPerMm};
};

TEST_F(LabLedHips, InFreeSpaceTheHandIsWhereItIsLed) {
  const std::vector<Vec3> hips_mm = HipsOfLedHand(surface_, settings_, To(8.0, 500));
  ASSERT_EQ(hips_mm.size(), 1000u);
  EXPECT_NEAR((hips_mm.front() - Vec3(2, 10, 10)).norm(), 0.0, 2.0 * kResolutionMm);
  EXPECT_NEAR((hips_mm.back() - Vec3(8, 10, 10)).norm(), 0.0, 2.0 * kResolutionMm);
}

// Two springs in a row: the hand's and the surface's.
TEST_F(LabLedHips, InContactTheForceDeflectsTheHand) {
  constexpr double kTarget_mm = 12.5, kSurface_mm = 9.5;
  const std::vector<Vec3> hips_mm = HipsOfLedHand(surface_, settings_, To(kTarget_mm, 1000));
  const double depth_mm =
      (kTarget_mm - kSurface_mm) * kSpringNPerMm / (kSpringNPerMm + kStiffnessNPerMm);
  EXPECT_NEAR(hips_mm.back().x(), kSurface_mm + depth_mm, 2.0 * kResolutionMm);
  const ReplayTick last = Replay(surface_, settings_, hips_mm, 1).back();
  EXPECT_NEAR(last.output.force_D_n.x(), -kStiffnessNPerMm * depth_mm,
              2.0 * kResolutionMm * kStiffnessNPerMm);
}

TEST_F(LabLedHips, TheSameTrajectoryGivesTheSameBits) {
  const std::vector<Vec3> targets_mm = To(13.0, 300);
  EXPECT_EQ(HipsOfLedHand(surface_, settings_, targets_mm),
            HipsOfLedHand(surface_, settings_, targets_mm));
}

TEST_F(LabLedHips, WhatIsNoTargetIsRefused) {
  EXPECT_THROW(HipsOfLedHand(surface_, settings_, {}), Error);
  EXPECT_THROW(HipsOfLedHand(surface_, settings_,
                             {Vec3::Zero(), Vec3(0, std::numeric_limits<double>::quiet_NaN(), 0)}),
               Error);
}

}  // namespace
}  // namespace palpate::lab
