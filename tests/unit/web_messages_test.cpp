// What browsers get: the bytes of a pose by a table of their own, and the texts of topics.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "client/web/source/pose_bytes.h"
#include "client/web/source/rights.h"
#include "client/web/source/topic_text.h"

namespace palpate::web {
namespace {

using nlohmann::json;

template <class T>
T At(const std::string& bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, &bytes.at(offset), sizeof value);
  return value;
}

client::Pose SomePose() {
  client::Pose pose;
  pose.tick = 123456789012;
  pose.time_ns = 5'000'000'000;
  pose.hip_mm = {1, 2, 3};
  pose.scp_h_mm = {4, 5, 6};
  pose.scp_h_normal = Vec3(0, 0, 1);
  pose.scp_v_mm = Vec3(7, 8, 9);
  pose.stylus_orientation = client::UnalignedQuaternion(0.4, 0.1, 0.2, 0.3);
  pose.buttons = 5;
  pose.force_n = {-1, -2, -3};
  pose.mode = client::ProxyMode::kConstrained;
  pose.contact = true;
  pose.density = 41.5;
  pose.isovalue = 42.5;
  pose.settings_revision = 77;
  pose.volume_revision = 88;
  pose.update_ns = 12'500;
  pose.missed_ticks = 9;
  pose.free_side = client::FreeSide::kAbove;
  pose.forces = {client::ForceState::kFault, client::ForceReason::kStopButton, 3.25};
  return pose;
}

TEST(PoseBytes, EveryFieldIsAtItsOffset) {
  const std::string bytes =
      EncodePose(SomePose(), {.sent_ns = 5'002'500'000, .shares_clock = true, .is_fresh = true});
  ASSERT_EQ(bytes.size(), 176u);
  EXPECT_EQ(At<std::uint8_t>(bytes, 0), 1);
  EXPECT_EQ(At<std::uint8_t>(bytes, 1), 31);
  EXPECT_EQ(At<std::uint8_t>(bytes, 2), 2);  // constrained
  EXPECT_EQ(At<std::uint8_t>(bytes, 3), 5);  // fault
  EXPECT_EQ(At<std::uint32_t>(bytes, 4), 0u);
  const double doubles[] = {123456789012.0, 5000.0, 5002.5, 2.5, 77.0, 88.0};
  for (std::size_t n = 0; n < 6; ++n) EXPECT_EQ(At<double>(bytes, 8 + 8 * n), doubles[n]) << n;
  const float singles[] = {1, 2, 3, 4, 5, 6, 0, 0, 1, 7, 8, 9, 0.1f, 0.2f, 0.3f, 0.4f, -1, -2, -3};
  for (std::size_t n = 0; n < std::size(singles); ++n) {
    EXPECT_EQ(At<float>(bytes, 56 + 4 * n), singles[n]) << n;
  }
  EXPECT_EQ(At<float>(bytes, 132), 3.25f);
  EXPECT_EQ(At<float>(bytes, 136), 41.5f);
  EXPECT_EQ(At<float>(bytes, 140), 42.5f);
  EXPECT_EQ(At<std::uint32_t>(bytes, 144), 5u);
  EXPECT_EQ(At<std::uint32_t>(bytes, 148), 9u);
  EXPECT_EQ(At<float>(bytes, 152), 12.5f);
  EXPECT_EQ(At<std::uint8_t>(bytes, 156), 12);  // stop button
  EXPECT_EQ(bytes.substr(157), std::string(19, '\0'));
}

TEST(PoseBytes, FlagsSayWhatIsThere) {
  const auto flags = [](const client::Pose& pose, bool is_fresh) {
    return At<std::uint8_t>(EncodePose(pose, {0, false, is_fresh}), 1);
  };
  client::Pose pose = SomePose();
  EXPECT_EQ(flags(pose, false), 15);
  pose.contact = false;
  EXPECT_EQ(flags(pose, false), 14);
  pose.scp_h_normal.reset();
  EXPECT_EQ(flags(pose, false), 12);
  pose.scp_v_mm.reset();
  EXPECT_EQ(flags(pose, false), 8);
  pose.free_side = client::FreeSide::kBelow;
  EXPECT_EQ(flags(pose, false), 0);
  EXPECT_EQ(flags(pose, true), 16);
  pose.replayed = true;
  EXPECT_EQ(flags(pose, true), 48);
  EXPECT_EQ(flags(pose, false), 32);
  EXPECT_TRUE(std::isnan(At<double>(EncodePose(pose, {0, false, true}), 32)));
}

TEST(PoseBytes, AForwardedPoseHasThisGatewaysTimes) {
  const std::string sent =
      EncodePose(SomePose(), {.sent_ns = 5'002'500'000, .shares_clock = true, .is_fresh = true});
  const auto forward = [&](std::int64_t now_ns, bool shares_clock, bool is_fresh = true) {
    return ForwardedPose(sent, {now_ns, shares_clock, is_fresh}).value();
  };
  const std::string near = forward(5'010'000'000, true);
  EXPECT_EQ(At<double>(near, 24), 5010.0);
  EXPECT_EQ(At<double>(near, 32), 10.0);
  // All else is as it was.
  EXPECT_EQ(near.substr(0, 24), sent.substr(0, 24));
  EXPECT_EQ(near.substr(40), sent.substr(40));
  const std::string far = forward(77'000'000, false);
  EXPECT_EQ(At<double>(far, 24), 77.0);
  EXPECT_TRUE(std::isnan(At<double>(far, 32)));
  // What was sent later than now was sent by another clock.
  EXPECT_TRUE(std::isnan(At<double>(forward(5'002'000'000, true), 32)));
}

TEST(PoseBytes, AForwardedPoseIsFreshIfItWasAndIs) {
  for (const bool was : {false, true}) {
    for (const bool is : {false, true}) {
      const std::string sent = EncodePose(SomePose(), {0, true, was});
      EXPECT_EQ(At<std::uint8_t>(ForwardedPose(sent, {0, true, is}).value(), 1),
                15 + (was && is ? 16 : 0));
    }
  }
}

TEST(PoseBytes, NoAgeComesOfAPoseWithNumbersThatAreNone) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const std::size_t at : {24u, 32u}) {
    for (const double number : {std::nan(""), infinity, -infinity, 1e300, -1.0}) {
      if (at == 24 && number == -1.0) continue;  // an old pose
      std::string sent = EncodePose(SomePose(), {0, true, true});
      std::memcpy(&sent.at(at), &number, sizeof number);
      const std::string forwarded = ForwardedPose(sent, {1'000'000, true, true}).value();
      EXPECT_EQ(At<double>(forwarded, 24), 1.0);
      const double age_ms = At<double>(forwarded, 32);
      EXPECT_TRUE(std::isnan(age_ms) || (age_ms >= 0 && age_ms < 1e12)) << number;
    }
  }
}

TEST(PoseBytes, WhatIsNoPoseIsNotForwarded) {
  const std::string pose = EncodePose(SomePose(), {0, true, true});
  std::string other = pose;
  other[0] = 2;
  for (const std::string& bytes : {std::string(), pose.substr(1), pose + '\0', other}) {
    EXPECT_FALSE(ForwardedPose(bytes, {0, true, true})) << bytes.size();
  }
}

// The daemon's strings reach the page as plain lines, whatever they hold.
TEST(TopicTexts, TextsOfOthersAreHarmless) {
  client::VolumeInfo info;
  info.source = "/secret/folder/<script>\n\x01\xff\"x.nrrd";
  VolumeLattice lattice;
  lattice.size = {10, 20, 300};
  lattice.type = LeafType::kInt16;
  lattice.value_min = -5.0;
  lattice.X_WI.translation = {1, 2, 3};
  const json volume = json::parse(VolumeText(info, lattice));
  EXPECT_EQ(volume["name"], "<script>  \xef\xbf\xbd\"x.nrrd");
  info.source = "/secret/series/";
  EXPECT_EQ(json::parse(VolumeText(info, lattice))["name"], "series");
  EXPECT_EQ(volume["size"], (json{10, 20, 300}));
  EXPECT_EQ(volume["voxel_type"], "int16");
  EXPECT_EQ(volume["background"], -5.0);
  EXPECT_EQ(volume["world_from_index"], (json{1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3}));
  EXPECT_FALSE(volume.contains("window"));
  lattice.window_level = 700.0;
  lattice.window_width = 2600.0;
  EXPECT_EQ(json::parse(VolumeText(info, lattice))["window"],
            (json{{"level", 700}, {"width", 2600}}));
  const json placement = json::parse(PlacementText({{}, 7, "RAS\n", true}));
  EXPECT_EQ(placement["patient_axes"], "RAS ");
  EXPECT_EQ(placement["patient_axes_answered"], true);
  EXPECT_EQ(json::parse(NoVolumeText("loading\nx"))["loading"], "loading x");
  EXPECT_FALSE(json::parse(NoVolumeText("")).contains("loading"));
}

TEST(Rights, MoreThanTheGatewayNeedsAreWarnedOf) {
  using client::Role;
  for (const Role role : {Role::kUnknown, Role::kViewer}) EXPECT_EQ(RightsWarning(role, false), "");
  for (const Role role : {Role::kUnknown, Role::kViewer, Role::kEditor}) {
    EXPECT_EQ(RightsWarning(role, true), "");
  }
  EXPECT_NE(RightsWarning(Role::kEditor, false), "");
  for (const Role role : {Role::kOperator, Role::kAdmin}) {
    EXPECT_NE(RightsWarning(role, false), "");
    EXPECT_NE(RightsWarning(role, true), "");
  }
}

TEST(TopicTexts, GuestsAreNotToldWherePalpatedIs) {
  const std::string secret = "no palpated at unix:/run/palpate/none.sock";
  EXPECT_EQ(PlainWhy(client::ConnectionState::kConnected), "");
  EXPECT_NE(PlainWhy(client::ConnectionState::kConnecting), "");
  EXPECT_NE(PlainWhy(client::ConnectionState::kLost), "");
  EXPECT_EQ(PlainProblem({}), "");
  const std::string problem = PlainProblem({.problem = secret});
  EXPECT_NE(problem, "");
  EXPECT_EQ(problem.find("none.sock"), std::string::npos);
  EXPECT_EQ(PlainProblem({.problem = "40 %", .is_loading = true}), "40 %");
  for (const ErrorKind kind : {ErrorKind::kInternal, ErrorKind::kUnavailable, ErrorKind::kCancelled,
                               ErrorKind::kPermissionDenied, ErrorKind::kLoading}) {
    const std::string refusal = PlainRefusal(Error(kind, secret));
    EXPECT_NE(refusal, "");
    EXPECT_EQ(refusal.find("none.sock"), std::string::npos);
  }
  EXPECT_EQ(PlainRefusal(Error(ErrorKind::kInvalidArgument, "at most 5")), "at most 5");
}

TEST(TopicTexts, HelloHasTheSettingsThatTheUserMaySteerAndTheIsovalue) {
  const auto keys = [](const std::vector<std::string>& may_steer) {
    const json hello =
        json::parse(HelloText({.version = "1", .user = "a", .may_steer = may_steer}));
    std::vector<std::string> found;
    for (const json& setting : hello["settings"]) found.push_back(setting["key"]);
    return found;
  };
  EXPECT_EQ(keys({}), std::vector<std::string>{"isovalue"});
  EXPECT_EQ(keys({"method", "stiffness_n_per_mm"}),
            (std::vector<std::string>{"isovalue", "stiffness_n_per_mm", "method"}));
  const json settings = json::parse(HelloText({.may_steer = {"method"}}))["settings"];
  EXPECT_EQ(settings[0]["minimum"], json());
  EXPECT_EQ(settings[1]["kind"], "choice");
  EXPECT_EQ(settings[1]["words"].size(), 2u);
}

TEST(TopicTexts, SettingsHaveAllThatTheDaemonKnows) {
  client::Settings settings;
  settings.isovalue = 12.5;
  settings.force_shading = true;
  settings.revision = 4;
  settings.unknown.set(2);
  const json text = json::parse(SettingsText(settings));
  EXPECT_EQ(text["revision"], 4);
  EXPECT_EQ(text["values"].size(), client::kSettings.size());
  EXPECT_EQ(text["values"]["isovalue"], 12.5);
  EXPECT_EQ(text["values"]["force_shading"], true);
  EXPECT_EQ(text["values"]["method"], "tpbcc");
  EXPECT_EQ(text["values"]["stiffness_n_per_mm"], json());
}

TEST(TopicTexts, OnlyValuesOfASettingsKindAreTaken) {
  EXPECT_EQ(UpdateOf("isovalue", -3.5)->isovalue, -3.5);
  EXPECT_EQ(UpdateOf("force_shading", 1.0)->force_shading, true);
  EXPECT_EQ(UpdateOf("free_side", 1.0)->free_side, client::FreeSide::kAbove);
  EXPECT_FALSE(UpdateOf("isovalue", NAN));
  EXPECT_FALSE(UpdateOf("isovalue", INFINITY));
  EXPECT_FALSE(UpdateOf("force_shading", 0.5));
  EXPECT_FALSE(UpdateOf("free_side", 2.0));
  EXPECT_FALSE(UpdateOf("free_side", -1.0));
  EXPECT_FALSE(UpdateOf("expected_revision", 1.0));
  EXPECT_FALSE(UpdateOf("", 1.0));
}

TEST(TopicTexts, AFacingIsTwoDirections) {
  EXPECT_EQ(FacingOf("facing", 0.0)->face, "+x");
  EXPECT_EQ(FacingOf("facing", 22.0)->face, "-y");
  EXPECT_EQ(FacingOf("facing", 22.0)->head, "+z");
  EXPECT_EQ(FacingOf("facing", 35.0)->head, "-z");
  for (const double bad : {-1.0, 36.0, double{NAN}, double{INFINITY}}) {
    EXPECT_FALSE(FacingOf("facing", bad));
  }
  EXPECT_FALSE(FacingOf("isovalue", 0.0));
}

}  // namespace
}  // namespace palpate::web
