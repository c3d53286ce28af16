// Where volumes lie: exact geometry, long sequences of moves, bad input.
#include "server/felt/registration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <set>
#include <string>

#include "server/simulated_hand/simulated_device.h"
#include "tests/support/refusal.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using testing::Refusal;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kQuarter = std::numbers::pi / 2.0;

// Anisotropic, turned, mirrored and far from the origin of W.
VolumeMetadata OddVolume() {
  VolumeMetadata metadata;
  metadata.size = Vec3i(31, 42, 6);
  metadata.spacing_mm = Vec3(0.5, 1.0, 2.5);
  metadata.origin_W_mm = Vec3(-210, 500, 3);
  metadata.direction << 0, 1, 0, -1, 0, 0, 0, 0, -1;
  return metadata;
}

// Turned by no multiple of a quarter.
VolumeMetadata TiltedVolume() {
  VolumeMetadata metadata = OddVolume();
  metadata.direction =
      Eigen::AngleAxisd(0.7, Vec3(1, 2, -0.5).normalized()).toRotationMatrix() * metadata.direction;
  return metadata;
}

Eigen::Quaterniond TurnAbout(double angle_rad, const Vec3& axis) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, axis.normalized()));
}

VolumePlace Change(const VolumePlace& from, const UpdateRegistrationRequest& update,
                   const VolumeMetadata& volume = OddVolume()) {
  return Apply(update, volume, SimulatedDeviceSpec(), from);
}

VolumePlace Fit(const VolumeMetadata& volume = OddVolume()) {
  return FitToWorkspace(volume, SimulatedDeviceSpec(), std::nullopt);
}

void ExpectSame(const VolumePlace& a, const VolumePlace& b) {
  EXPECT_EQ(a.device_mm_per_volume_mm, b.device_mm_per_volume_mm);
  EXPECT_EQ(a.p_DCenter_mm, b.p_DCenter_mm);
  EXPECT_EQ(a.R_DW.coeffs(), b.R_DW.coeffs());
  EXPECT_EQ(a.X_DW.linear, b.X_DW.linear);
  EXPECT_EQ(a.X_DW.translation, b.X_DW.translation);
}

// How far X_DW is from scale times a rotation, relative to the scale.
double OffSimilarity(const VolumePlace& registration) {
  const Mat3 unit = registration.X_DW.linear / registration.device_mm_per_volume_mm;
  return (unit * unit.transpose() - Mat3::Identity()).norm() + std::abs(unit.determinant() - 1.0);
}

TEST(VolumePlace, TheCentreIsTheMiddleOfTheLattice) {
  EXPECT_EQ(VolumeCenterMm(OddVolume()), Vec3(-210 + 20.5, 500 - 7.5, 3 - 6.25));
}

TEST(VolumePlace, AFittedVolumeFillsTheWorkspaceAndNoMore) {
  for (const VolumeMetadata& volume : {OddVolume(), TiltedVolume()}) {
    const VolumePlace fit = Fit(volume);
    const AffineMap X_DI = fit.X_DW * volume.WorldFromIndex();
    Vec3 extent = Vec3::Zero();
    for (int c = 0; c < 8; ++c) {
      const Vec3 p_I(c & 1 ? 30 : 0, c & 2 ? 41 : 0, c & 4 ? 5 : 0);
      extent = extent.cwiseMax(X_DI.Apply(p_I).cwiseAbs());
    }
    EXPECT_NEAR((extent.array() / Eigen::Array3d(80, 60, 35)).maxCoeff(), kWorkspaceFill, 1e-12);
    EXPECT_EQ(fit.p_DCenter_mm, Vec3::Zero());
    EXPECT_EQ(fit.R_DW.coeffs(), Eigen::Quaterniond::Identity().coeffs());
  }
}

TEST(VolumePlace, AbsolutePartsAreReadBackAsGiven) {
  const Eigen::Quaterniond turn(0.5, 0.5, -0.5, 0.5);
  const VolumePlace placed = Change(
      Fit(),
      {.center_mm = Vec3(0.1, -7.3, 1e3), .rotation = turn, .device_mm_per_volume_mm = 0.123});
  EXPECT_EQ(placed.p_DCenter_mm, Vec3(0.1, -7.3, 1e3));
  EXPECT_EQ(placed.R_DW.coeffs(), turn.coeffs());
  EXPECT_EQ(placed.device_mm_per_volume_mm, 0.123);
  EXPECT_NEAR((placed.X_DW.Apply(VolumeCenterMm(OddVolume())) - placed.p_DCenter_mm).norm(), 0.0,
              1e-12);
  EXPECT_NEAR((placed.X_DW.linear - 0.123 * turn.toRotationMatrix()).norm(), 0.0, 1e-15);
  // The turns q and -q are one.
  const Eigen::Quaterniond same(-0.5, -0.5, 0.5, -0.5);
  EXPECT_EQ(Change(placed, {.rotation = same}).R_DW.coeffs(), turn.coeffs());
}

TEST(VolumePlace, WhatIsAbsentKeepsItsBits) {
  const VolumePlace placed =
      Change(Fit(), {.center_mm = Vec3(1, 2, 3), .rotation = TurnAbout(0.3, Vec3(1, 2, 3))});
  ExpectSame(Change(placed, {}), placed);
  VolumePlace same = placed;
  for (int n = 0; n < 1000; ++n) same = Change(same, {});
  ExpectSame(same, placed);
  const VolumePlace moved = Change(placed, {.center_mm = Vec3(4, 5, 6)});
  EXPECT_EQ(moved.R_DW.coeffs(), placed.R_DW.coeffs());
  EXPECT_EQ(moved.device_mm_per_volume_mm, placed.device_mm_per_volume_mm);
}

TEST(VolumePlace, AScalePerVoxelIsThatOfTheShortestEdge) {
  const VolumePlace placed = Change(Fit(), {.device_mm_per_voxel = 0.25});
  EXPECT_EQ(placed.device_mm_per_volume_mm, 0.5);
  EXPECT_EQ(DeviceMmPerVoxel(placed, OddVolume()), 0.25);
  const AffineMap X_DI = placed.X_DW * OddVolume().WorldFromIndex();
  EXPECT_NEAR(X_DI.linear.colwise().norm().minCoeff(), 0.25, 1e-15);
}

TEST(VolumePlace, TurnsAndScalingLeaveTheCentreWhereItIs) {
  const VolumePlace placed = Change(Fit(), {.center_mm = Vec3(5, -6, 7)});
  const VolumePlace turned =
      Change(placed, {.rotate = TurnAbout(kQuarter, Vec3::UnitY()), .scale_by = 2.0});
  EXPECT_EQ(turned.p_DCenter_mm, placed.p_DCenter_mm);
  EXPECT_EQ(turned.device_mm_per_volume_mm, 2.0 * placed.device_mm_per_volume_mm);
  // What was at +z of the centre, in D, is at +x of it, twice as far.
  const Vec3 p_W = VolumeCenterMm(OddVolume()) + Vec3(0, 0, 1.0 / placed.device_mm_per_volume_mm);
  EXPECT_NEAR((placed.X_DW.Apply(p_W) - Vec3(5, -6, 8)).norm(), 0.0, 1e-12);
  EXPECT_NEAR((turned.X_DW.Apply(p_W) - Vec3(7, -6, 7)).norm(), 0.0, 1e-12);
}

TEST(VolumePlace, TurnsAreAboutTheAxesOfTheDevice) {
  const VolumePlace tilted = Change(Fit(), {.rotation = TurnAbout(kQuarter, Vec3::UnitX())});
  const VolumePlace both = Change(tilted, {.rotate = TurnAbout(kQuarter, Vec3::UnitZ())});
  // W's y axis was D's z; a turn about that leaves it there.
  EXPECT_NEAR((both.R_DW * Vec3::UnitY() - Vec3::UnitZ()).norm(), 0.0, 1e-15);
  EXPECT_NEAR((both.R_DW * Vec3::UnitX() - Vec3::UnitY()).norm(), 0.0, 1e-15);
}

TEST(VolumePlace, ResetComesFirstThenAbsoluteThenRelativeParts) {
  const VolumePlace far = Change(Fit(), {.center_mm = Vec3(500, 0, 0),
                                         .rotation = TurnAbout(1.0, Vec3(1, 1, 1)),
                                         .device_mm_per_volume_mm = 9.0});
  ExpectSame(Change(far, {.reset = true}), Fit());
  const VolumePlace all = Change(far, {.reset = true,
                                       .center_mm = Vec3(1, 2, 3),
                                       .rotation = TurnAbout(kQuarter, Vec3::UnitX()),
                                       .device_mm_per_volume_mm = 0.5,
                                       .translate_mm = Vec3(10, 0, 0),
                                       .rotate = TurnAbout(-kQuarter, Vec3::UnitX()),
                                       .scale_by = 4.0});
  EXPECT_EQ(all.p_DCenter_mm, Vec3(11, 2, 3));
  EXPECT_EQ(all.device_mm_per_volume_mm, 2.0);
  EXPECT_NEAR(all.R_DW.angularDistance(Eigen::Quaterniond::Identity()), 0.0, 1e-15);
  const VolumePlace partly = Change(far, {.reset = true, .translate_mm = Vec3(0, 1, 0)});
  EXPECT_EQ(partly.p_DCenter_mm, Vec3(0, 1, 0));
  EXPECT_EQ(partly.device_mm_per_volume_mm, Fit().device_mm_per_volume_mm);
}

TEST(VolumePlace, EveryMoveHasItsInverse) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  const auto vector = [&] { return Vec3(share(random), share(random), share(random)); };
  const VolumeMetadata volume = TiltedVolume();
  for (int n = 0; n < 1000; ++n) {
    const VolumePlace from = Change(
        Fit(volume), {.center_mm = 50.0 * vector(), .rotation = TurnAbout(3.0, vector())}, volume);
    const Vec3 by_mm = 100.0 * vector();
    const Eigen::Quaterniond turn = TurnAbout(3.0 * share(random), vector());
    const double factor = std::exp(share(random));
    const VolumePlace there =
        Change(from, {.translate_mm = by_mm, .rotate = turn, .scale_by = factor}, volume);
    const VolumePlace back = Change(
        there, {.translate_mm = -by_mm, .rotate = turn.conjugate(), .scale_by = 1.0 / factor},
        volume);
    EXPECT_NEAR((back.X_DW.linear - from.X_DW.linear).norm(), 0.0, 1e-13);
    EXPECT_NEAR((back.X_DW.translation - from.X_DW.translation).norm(), 0.0, 1e-11);
  }
}

TEST(VolumePlace, ManyMovesLeaveItASimilarity) {
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  const VolumeMetadata volume = TiltedVolume();
  VolumePlace registration = Fit(volume);
  double worst = 0.0;
  for (int n = 0; n < test::Scaled(30'000); ++n) {
    // As a float client would send it.
    Eigen::Quaterniond turn =
        TurnAbout(1e-3 * normal(random), Vec3(normal(random), normal(random), 1.0));
    turn = turn.cast<float>().cast<double>();
    registration = Change(registration,
                          {.translate_mm = 1e-3 * Vec3(normal(random), normal(random), 0.1),
                           .rotate = turn,
                           .scale_by = n % 2 ? 1.001 : 1.0 / 1.001},
                          volume);
    worst = std::max(worst, OffSimilarity(registration));
  }
  EXPECT_LT(worst, 5e-14);
  EXPECT_NEAR(registration.device_mm_per_volume_mm / Fit(volume).device_mm_per_volume_mm, 1.0,
              1e-9);
  EXPECT_NEAR((registration.X_DW.Apply(VolumeCenterMm(volume)) - registration.p_DCenter_mm).norm(),
              0.0, 1e-11);
}

TEST(VolumePlace, TheLimitsThemselvesAreGood) {
  VolumeMetadata cube;
  cube.size = Vec3i(2, 2, 2);
  for (const double scale : {kLeastVoxelMm, kGreatestVoxelMm}) {
    EXPECT_EQ(Change(Fit(cube), {.device_mm_per_voxel = scale}, cube).device_mm_per_volume_mm,
              scale);
  }
  for (const double mm : {-kFarthestCenterMm, kFarthestCenterMm}) {
    EXPECT_EQ(Change(Fit(), {.center_mm = Vec3(mm, 0, mm)}).p_DCenter_mm, Vec3(mm, 0, mm));
  }
}

TEST(VolumePlace, BadInputIsRefused) {
  const Eigen::Quaterniond identity = Eigen::Quaterniond::Identity();
  const double above = std::nextafter(kFarthestCenterMm, kInf);
  const std::vector<UpdateRegistrationRequest> bad = {
      {.center_mm = Vec3(0, kNan, 0)},
      {.center_mm = Vec3(kInf, 0, 0)},
      {.center_mm = Vec3(0, 0, -above)},
      {.rotation = Eigen::Quaterniond(0, 0, 0, 0)},
      {.rotation = Eigen::Quaterniond(1, 1, 0, 0)},
      {.rotation = Eigen::Quaterniond(0.99, 0, 0, 0)},
      {.rotation = Eigen::Quaterniond(kNan, 0, 0, 0)},
      {.rotation = Eigen::Quaterniond(kInf, 0, 0, 0)},
      {.rotation = Eigen::Quaterniond(1e300, 1e300, 0, 0)},
      {.device_mm_per_volume_mm = 0.0},
      {.device_mm_per_volume_mm = -1.0},
      {.device_mm_per_volume_mm = kNan},
      {.device_mm_per_volume_mm = kInf},
      {.device_mm_per_volume_mm = 1.9e-6},  // the shortest edge is half a mm
      {.device_mm_per_volume_mm = 0.41e6},  // the longest 2.5 mm
      {.device_mm_per_voxel = 0.9e-6},
      {.device_mm_per_voxel = -0.25},
      {.device_mm_per_voxel = kNan},
      {.device_mm_per_volume_mm = 1.0, .device_mm_per_voxel = 0.5},
      {.translate_mm = Vec3(kNan, 0, 0)},
      {.translate_mm = Vec3(0, -kInf, 0)},
      {.center_mm = Vec3(kFarthestCenterMm, 0, 0), .translate_mm = Vec3(1, 0, 0)},
      // What is absolute is checked before what is relative.
      {.center_mm = Vec3(above, 0, 0), .translate_mm = Vec3(-1, 0, 0)},
      {.rotate = Eigen::Quaterniond(0, 0, 0, 0)},
      {.rotate = Eigen::Quaterniond(0, 0, 0, 1.01)},
      {.rotate = Eigen::Quaterniond(1, 0, kNan, 0)},
      {.scale_by = 0.0},
      {.scale_by = -2.0},
      {.scale_by = kNan},
      {.scale_by = kInf},
      {.scale_by = 1e-12},
      {.reset = true, .rotate = identity, .scale_by = 1e12}};
  for (std::size_t n = 0; n < bad.size(); ++n) {
    EXPECT_EQ(Refusal([&] { Change(Fit(), bad[n]); }), ErrorKind::kInvalidArgument) << n;
  }
}

TEST(PatientFacing, LeftIsOnTheLeftOfWhoFacesThere) {
  // As DICOM has them; seen from the feet; lying on the right side, with the head to -x.
  EXPECT_EQ(PatientAxesOf({"-y", "+z"}), "LPS");
  EXPECT_EQ(PatientAxesOf({"+y", "+z"}), "RAS");
  EXPECT_EQ(PatientAxesOf({"+z", "-x"}), "ILA");
  std::set<std::string> all;
  for (const std::string face : {"+x", "-x", "+y", "-y", "+z", "-z"}) {
    for (const std::string head : {"+x", "-x", "+y", "-y", "+z", "-z"}) {
      if (face[1] == head[1]) {
        EXPECT_EQ(Refusal([&] { PatientAxesOf({face, head}); }), ErrorKind::kInvalidArgument);
      } else {
        all.insert(PatientAxesOf({face, head}));
      }
    }
  }
  EXPECT_EQ(all.size(), 24u);
  for (const std::string& axes : all) EXPECT_TRUE(IsAnsweredAxes(axes)) << axes;
  for (const char* const none : {"", "LP", "RPS", "LPX", "LLS", "lps"}) {
    EXPECT_FALSE(IsAnsweredAxes(none)) << none;
  }
  for (const char* const word : {"", "x", "+X", "+w", "y+"}) {
    EXPECT_EQ(Refusal([&] { PatientAxesOf({word, "+z"}); }), ErrorKind::kInvalidArgument) << word;
  }
}

TEST(VolumePlace, RotationsRoundedToFloatAreTaken) {
  const Eigen::Quaterniond turn = TurnAbout(1.1, Vec3(3, 1, 2));
  const Eigen::Quaterniond rounded = turn.cast<float>().cast<double>();
  ASSERT_NE(rounded.norm(), 1.0);
  const VolumePlace placed = Change(Fit(), {.rotation = rounded});
  EXPECT_NEAR(placed.R_DW.norm(), 1.0, 1e-15);
  EXPECT_LT(placed.R_DW.angularDistance(turn), 1e-6);
  EXPECT_LT(OffSimilarity(placed), 1e-14);
}

}  // namespace
}  // namespace palpate
