// Trajectories, settings and reports of replays; and a hand that is led along a trajectory.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <sstream>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/lab/commands.h"
#include "server/lab/gbid.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/led_hips.h"
#include "server/lab/mesh.h"
#include "server/lab/replay.h"
#include "server/lab/replay_report.h"
#include "server/lab/trajectory.h"
#include "server/lab/trajectory_file.h"
#include "server/lab/triangle_grid.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate::lab {

namespace {

using testing::Complaint;

class LabTrajectoryFile : public ::testing::Test {
 protected:
  std::string ComplaintAbout(const std::string& text) {
    std::ofstream(file_) << text;
    return Complaint([&] { ReadTrajectory(file_); });
  }

  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "t.csv";
};

TEST_F(LabTrajectoryFile, KeepsEveryBit) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Vec3> hips = {Vec3(0.1, -1.0 / 3.0, 1e-300), Vec3(nan, 1, 2),
                                  Vec3(1e308, -std::numeric_limits<double>::infinity(), -0.0)};
  WriteTrajectory(file_, hips, IfThere::kReplace);
  const std::vector<Vec3> read = ReadTrajectory(file_);
  ASSERT_EQ(read.size(), hips.size());
  EXPECT_EQ(read[0], hips[0]);
  EXPECT_TRUE(std::isnan(read[1].x()));
  EXPECT_EQ(read[2], hips[2]);
}

TEST_F(LabTrajectoryFile, TakesColumnsByName) {
  std::ofstream(file_) << "tick, hip_y,hip_x ,hip_z,more\r\n0,2,1,+3,x\r\n\r\n1,5,4,6\n";
  const std::vector<Vec3> read = ReadTrajectory(file_);
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[0], Vec3(1, 2, 3));
  EXPECT_EQ(read[1], Vec3(4, 5, 6));
}

TEST_F(LabTrajectoryFile, NamesTheLineOfAnError) {
  const std::pair<const char*, const char*> cases[] = {{"", "line 1"},
                                                       {"1,2,3\n", "line 1"},
                                                       {"x_mm,y_mm\n1,2\n", "line 1"},
                                                       {"x_mm,x_mm,y_mm\n1,2,3\n", "line 1"},
                                                       {"x_mm,y_mm,z_mm\n", "position"},
                                                       {"x_mm,y_mm,z_mm\n1,2,3\n\n1,2\n", "line 4"},
                                                       {"x_mm,y_mm,z_mm\n1,2,3mm\n", "'3mm'"},
                                                       {"x_mm,y_mm,z_mm\n1,,3\n", "line 2"}};
  for (const auto& [text, named] : cases) {
    const std::string refusal = ComplaintAbout(text);
    EXPECT_NE(refusal.find(named), std::string::npos) << refusal;
    EXPECT_EQ(refusal.find('\n'), std::string::npos);
  }
  EXPECT_EQ(testing::Refusal([&] { ReadTrajectory(folder_.path() / "none.csv"); }),
            ErrorKind::kNotFound);
  EXPECT_EQ(testing::Refusal([&] { ReadTrajectory(folder_.path()); }), ErrorKind::kNotFound);
}

TEST(LabSettings, AreThoseOfTheRenderer) {
  HapticSettings settings;
  ApplySetting("damping_n_s_per_m=1.5", settings);
  ApplySetting("force_shading=true", settings);
  ApplySetting("free_side=above", settings);
  EXPECT_EQ(settings.damping_n_s_per_m, 1.5);
  EXPECT_TRUE(settings.force_shading);
  EXPECT_EQ(settings.free_side, FreeSide::kAbove);
}

TEST(LabSettings, RefusesWhatTheyCannotBe) {
  for (const char* argument :
       {"damping_n_s_per_m", "damping_n_s_per_m=", "damping_n_s_per_m=1x", "damping_n_s_per_m=nan",
        "damping_n_s_per_m=-1", "damping_n_s_per_m=5.1", "damping=1", "=1", "force_shading=1",
        "free_side=left", "free_side="}) {
    HapticSettings settings;
    const std::string complaint = Complaint([&] { ApplySetting(argument, settings); });
    EXPECT_NE(complaint, "") << argument;
    EXPECT_EQ(complaint.find('\n'), std::string::npos);
  }
  HapticSettings settings;
  EXPECT_NE(Complaint([&] { ApplySetting("damping=1", settings); }).find("damping_n_s_per_m"),
            std::string::npos);
}

LoadedSurface Bumps() {
  return LoadSurface(
      {.volume = "builtin:bumps:64", .isovalue = 0.5, .normalized = true, .spacing_mm = {0.5}});
}

TEST(LabTrajectory, SlidesLieInTheSurfaceAtTheirSpeed) {
  const LoadedSurface bumps = Bumps();
  const auto hips_mm = MakeTrajectory(*bumps.volume, {.isovalue = bumps.isovalue, .ticks = 3000});
  const AffineMap X_WI = bumps.volume->metadata().WorldFromIndex(), X_IW = X_WI.Inverse();
  const auto density = [&](const Vec3& p_mm) {
    return SampleField(*bumps.volume, X_IW.Apply(p_mm)).value;
  };
  const TriangleGrid triangles(ExtractSurface(*bumps.volume, bumps.isovalue, ComparedMethod::kTpbcc,
                                              PaddedCells(*bumps.volume)),
                               X_WI);
  EXPECT_LT(density(hips_mm[0]), bumps.isovalue);
  double way_mm = 0.0, shallowest_mm = 10.0, deepest_mm = 0.0;
  for (std::size_t n = 1000; n < hips_mm.size(); ++n) {
    const double depth_mm = triangles.Distance(hips_mm[n], 10.0);
    EXPECT_GT(density(hips_mm[n]), bumps.isovalue);
    shallowest_mm = std::min(shallowest_mm, depth_mm);
    deepest_mm = std::max(deepest_mm, depth_mm);
    way_mm += (hips_mm[n] - hips_mm[n - 1]).norm();
  }
  EXPECT_NEAR(shallowest_mm, 0.8, 0.05);
  EXPECT_NEAR(deepest_mm, 1.2, 0.05);
  // 10 cm/s for 2 s, but longer or shorter below a curved surface.
  EXPECT_GT(way_mm, 120.0);
  EXPECT_LT(way_mm, 280.0);
  EXPECT_EQ(hips_mm, MakeTrajectory(*bumps.volume, {.isovalue = bumps.isovalue, .ticks = 3000}));
}

TEST(LabTrajectory, RefusesASurfaceThatIsNotThere) {
  const LoadedSurface bumps = Bumps();
  EXPECT_NE(Complaint([&] { MakeTrajectory(*bumps.volume, {.isovalue = 0.0}); }).find("no place"),
            std::string::npos);
  EXPECT_NE(Complaint([&] { MakeTrajectory(*bumps.volume, {.ticks = 0}); }), "");
}

// All but the last column.
std::string WithoutTimes(const std::string& csv) {
  std::istringstream in(csv);
  std::string out;
  for (std::string line; std::getline(in, line);) out += line.substr(0, line.rfind(',')) + "\n";
  return out;
}

TEST(LabReplay, IsTheSameToTheByte) {
  const LoadedSurface bumps = Bumps();
  auto hips_mm = MakeTrajectory(*bumps.volume, {.isovalue = bumps.isovalue, .ticks = 2000});
  const auto csv = [&](int passes) {
    const JudgedReplay judged =
        ReplayAndJudge(bumps, DecompositionMethod::kTpbcc, HapticSettings{}, hips_mm, passes);
    return WithoutTimes(ToCsv(judged.ticks, judged.summary.verdict.density));
  };
  const std::string once = csv(1);
  EXPECT_EQ(std::count(once.begin(), once.end(), '\n'), 2001);
  EXPECT_EQ(once, csv(1));
  EXPECT_EQ(once, csv(3));
  hips_mm[1500].x() += 1e-9;
  EXPECT_NE(once, csv(1));
}

TEST(LabReplay, CountsWhatIsNoPosition) {
  const LoadedSurface bumps = Bumps();
  const Vec3 nan = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  const JudgedReplay judged = ReplayAndJudge(bumps, DecompositionMethod::kTpbcc, HapticSettings{},
                                             {nan, Vec3(1, 1, 1), -nan, Vec3(1, 1, 2)}, 1);
  EXPECT_EQ(judged.summary.verdict.rejected_ticks, 2);
  EXPECT_EQ(judged.summary.verdict.fall_throughs, 0);
  const std::string csv = ToCsv(judged.ticks, judged.summary.verdict.density);
  EXPECT_TRUE(csv.starts_with(
      "tick,hip_x,hip_y,hip_z,scp_h_x,scp_h_y,scp_h_z,scp_v_x,scp_v_y,scp_v_z,scp_v_valid,contact,"
      "force_x,force_y,force_z,density,tetrahedra,iterations,update_ns\n0,"));
  EXPECT_NE(csv.find("\n0,nan,nan,nan,nan,nan,nan,nan,nan,nan,0,0,0,0,0,nan,0,0,"),
            std::string::npos)
      << csv;
  EXPECT_NE(csv.find("\n2,nan,nan,nan,1,1,1,"), std::string::npos) << csv;
}

TEST(LabReplay, MeansAreOfTheTicksWithAVisualProxy) {
  Verdict verdict;
  verdict.scp_v_ticks = 4;
  verdict.scp_hv_voxels = 1.0;
  verdict.force_angle_deg = 6.0;
  const ReplaySummary summary = Summarise(std::vector<ReplayTick>(9), verdict);
  EXPECT_EQ(summary.mean_scp_hv_voxels(), 0.25);
  EXPECT_EQ(summary.mean_force_angle_deg(), 1.5);
}

TEST(LabReplay, SpacingIsOneNumberOrThree) {
  const auto load = [](std::vector<double> spacing_mm) {
    return LoadSurface({.volume = "builtin:sphere:16",
                        .isovalue = 0.5,
                        .normalized = true,
                        .spacing_mm = std::move(spacing_mm)});
  };
  EXPECT_EQ(load({1, 2, 3}).volume->metadata().spacing_mm, Vec3(1, 2, 3));
  EXPECT_EQ(load({0.25}).volume->metadata().spacing_mm, Vec3::Constant(0.25));
  for (const auto& bad : std::vector<std::vector<double>>{{1, 2}, {0}, {-1}, {NAN}, {1e9}}) {
    EXPECT_NE(Complaint([&] { load(bad); }), "");
  }
}

}  // namespace

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
