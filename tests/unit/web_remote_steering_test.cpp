// What guests of other sites may change here, whatever their site says of them.
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <string>
#include <variant>

#include "client/web/room/remote_steering.h"

namespace palpate::web {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;

constexpr Time kStart{std::chrono::hours(1)};

json Request(const std::string& key = "isovalue", double value = 0.5) {
  return {{"user", "ann"}, {"key", key}, {"value", value}};
}

class RemoteSteeringTest : public testing::Test {
 protected:
  bool IsMade(const std::string& site, const json& request, Time now = kStart) {
    return std::holds_alternative<SteerRequest>(steering_.Judge(site, request.dump(), now));
  }

  RemoteSteering steering_{{{"lyon", {"isovalue", "force_shading"}}, {"rome", {"isovalue"}}}};
};

TEST_F(RemoteSteeringTest, IsBoundToTheSiteOfTheSubjectAndItsKeys) {
  const auto judged = steering_.Judge("lyon", Request("force_shading", 1.0).dump(), kStart);
  ASSERT_TRUE(std::holds_alternative<SteerRequest>(judged));
  const auto& change = std::get<SteerRequest>(judged);
  EXPECT_EQ(change.user, "ann@lyon");
  EXPECT_EQ(change.key, "force_shading");
  EXPECT_EQ(change.value, 1.0);
  EXPECT_TRUE(IsMade("rome", Request()));
  EXPECT_FALSE(IsMade("rome", Request("force_shading", 1.0)));
  EXPECT_FALSE(IsMade("lyon", Request("force_shading", 2.0)));
  EXPECT_FALSE(IsMade("", Request()) || IsMade("Lyon", Request()) || IsMade("oslo", Request()));
  json other = Request();
  for (const char* const key : {"site", "name", "may_steer"}) other[key] = "lyon";
  EXPECT_FALSE(IsMade("oslo", other));
}

// Of all its guests together: who they are is the site's word.
TEST_F(RemoteSteeringTest, OfOneSiteTenASecond) {
  const auto made = [&](const std::string& site, Time now) {
    int count = 0;
    for (int n = 0; n < 30; ++n) {
      json request = Request();
      request["user"] = "guest-" + std::to_string(n);
      count += IsMade(site, request, now) ? 1 : 0;
    }
    return count;
  };
  EXPECT_EQ(made("lyon", kStart), 10);
  EXPECT_EQ(made("rome", kStart), 10);
  EXPECT_EQ(made("lyon", kStart + milliseconds(999)), 0);
  EXPECT_EQ(made("lyon", kStart + milliseconds(1000)), 10);
}

TEST_F(RemoteSteeringTest, EverySiteThatIsNamedMayStop) {
  for (int n = 0; n < 30; ++n) EXPECT_TRUE(IsMade("rome", Request("stop", 0.0)));
  EXPECT_TRUE(IsMade("rome", Request()));  // a stop takes no place
  EXPECT_FALSE(IsMade("oslo", Request("stop", 0.0)));
}

TEST_F(RemoteSteeringTest, RequestsThatMakeNoSenseAreRefused) {
  for (const char* const key : {"user", "key", "value"}) {
    for (const json& value : {json(), json(true), json::array(), json::object(), json("a b@c")}) {
      json request = Request();
      request[key] = value;
      EXPECT_FALSE(IsMade("lyon", request)) << request;
    }
    json request = Request();
    request.erase(key);
    EXPECT_FALSE(IsMade("lyon", request)) << request;
  }
  for (const std::string& user : {std::string(), std::string("ann@lyon"), std::string("a\nb"),
                                  std::string("../a"), std::string(2000, 'a')}) {
    json request = Request();
    request["user"] = user;
    EXPECT_FALSE(IsMade("lyon", request)) << user.substr(0, 20);
  }
  for (const char* const text : {"", "{", "[]", "null", "\xff"}) {
    EXPECT_FALSE(std::holds_alternative<SteerRequest>(steering_.Judge("lyon", text, kStart)));
  }
  EXPECT_TRUE(IsMade("lyon", Request()));
}

}  // namespace
}  // namespace palpate::web
