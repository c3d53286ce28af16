// The texts of topics that only the gateway knows, and what guests may steer.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "client/web/upstream/rights.h"
#include "client/web/upstream/topic_text.h"

namespace palpate::web {
namespace {

using nlohmann::json;

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
