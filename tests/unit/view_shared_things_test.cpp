// Who changed what is for everyone, and when it is worth pointing out.
#include "client/view/palpated/shared_things.h"

#include <gtest/gtest.h>

namespace palpate::view {
namespace {

using namespace std::chrono_literals;

constexpr SharedThings::Clock::time_point kNow = SharedThings::Clock::time_point{} + 1h;

client::Activity ActivityOf(const std::string& by, double ago_s) {
  return {.callers = {{.caller = {.identity = "token script"}, .peer = "ipv4:192.0.2.9:4000"},
                      {.caller = {.identity = "token ada"},
                       .peer = "ipv4:192.0.2.7:51544",
                       .is_you = true}},
          .changes = {{.what = "isovalue", .by = by, .ago_s = ago_s}}};
}

TEST(SharedThings, SomebodyElsesChangeIsFreshForAWhile) {
  SharedThings shared;
  EXPECT_FALSE(shared.Of("isovalue", kNow));
  shared.Take(ActivityOf("token script at ipv4:192.0.2.9:4000", 2.0), kNow);
  const auto change = shared.Of("isovalue", kNow + 1s);
  ASSERT_TRUE(change);
  EXPECT_EQ(change->by, "token script at 192.0.2.9");
  EXPECT_NEAR(change->age_s, 3.0, 1e-6);
  EXPECT_FALSE(change->is_own);
  EXPECT_TRUE(change->is_fresh);
  EXPECT_EQ(shared.FreshLine(kNow + 1s), "isovalue by token script at 192.0.2.9, 3 s ago");
  EXPECT_FALSE(shared.Of("isovalue", kNow + 5s)->is_fresh);
  EXPECT_EQ(shared.FreshLine(kNow + 5s), "");
  EXPECT_FALSE(shared.Of("voxels", kNow));
  shared.Take(std::nullopt, kNow);
  EXPECT_FALSE(shared.Of("isovalue", kNow));
}

TEST(SharedThings, OwnIsWhatThisViewerChangedAtThatTime) {
  const std::string us = "token ada at ipv4:192.0.2.7:60000";  // of another connection
  SharedThings shared;
  shared.NoteOwn("isovalue", kNow - 2s);
  shared.Take(ActivityOf(us, 1.9), kNow);
  EXPECT_TRUE(shared.Of("isovalue", kNow)->is_own);
  EXPECT_FALSE(shared.Of("isovalue", kNow)->is_fresh);
  // A second program of ours, before and after.
  for (const double ago_s : {4.0, 0.5}) {
    shared.NoteOwn("isovalue", ago_s > 2.0 ? kNow - 2s : kNow - 5s);
    shared.Take(ActivityOf(us, ago_s), kNow);
    EXPECT_FALSE(shared.Of("isovalue", kNow)->is_own) << ago_s;
  }
  // Somebody else at the same time.
  shared.NoteOwn("isovalue", kNow - 2s);
  shared.Take(ActivityOf("token script at ipv4:192.0.2.9:4000", 1.9), kNow);
  EXPECT_FALSE(shared.Of("isovalue", kNow)->is_own);
}

TEST(SharedThings, Words) {
  EXPECT_EQ(WithoutPort("local socket"), "local socket");
  EXPECT_EQ(WithoutPort("token a at ipv6:[::1]:60286"), "token a at [::1]");
  EXPECT_EQ(AgeInWords(0.3), "now");
  EXPECT_EQ(AgeInWords(61.0), "1 min");
  EXPECT_EQ(NameOfThing("stiffness_n_per_mm"), "stiffness");
  EXPECT_EQ(NameOfThing("voxels"), "voxels");
  client::Activity activity = ActivityOf("local socket", 3.0);
  EXPECT_EQ(ChangedByInWords(activity, {"voxels", "isovalue"}), "local socket, 3 s ago");
  EXPECT_EQ(ChangedByInWords(activity, {"voxels"}), "");
}

}  // namespace
}  // namespace palpate::view
