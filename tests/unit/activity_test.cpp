// Who uses the daemon, and who changed what.
#include "server/door/activity.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace palpate {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kHere = std::chrono::nanoseconds(Activity::kHere).count();
const Identity kAda{"token ada", Role::kOperator};
const Identity kBob{"token bob", Role::kViewer};

std::vector<std::string> NamesOf(const Activity& activity, std::int64_t now_ns) {
  std::vector<std::string> names;
  for (const Activity::Caller& caller : activity.callers(now_ns)) {
    names.push_back(WhoInWords(caller.identity, caller.address));
  }
  return names;
}

using Names = std::vector<std::string>;

TEST(Activity, ACallerIsHereWhileACallRunsAndForAWhile) {
  Activity activity;
  activity.Came(kBob, "ipv4:192.0.2.7:1", true, 1 * kSecond);
  activity.Came(kAda, "unix:", false, 2 * kSecond);
  activity.Left(kAda, "unix:", false, 3 * kSecond);
  const Names both = {"token bob at ipv4:192.0.2.7", "token ada"};
  EXPECT_EQ(NamesOf(activity, 3 * kSecond + kHere), both);
  EXPECT_EQ(NamesOf(activity, 4 * kSecond + kHere), Names{both[0]});
  const auto callers = activity.callers(3 * kSecond);
  EXPECT_TRUE(callers[0].watches);
  EXPECT_FALSE(callers[1].watches);
  EXPECT_EQ(callers[0].came_ns, 1 * kSecond);
  EXPECT_EQ(callers[1].identity.role, Role::kOperator);
  // It has been away: it comes anew, and last.
  activity.Left(kBob, "ipv4:192.0.2.7:1", true, 20 * kSecond);
  activity.Came(kAda, "unix:", false, 21 * kSecond);
  activity.Left(kAda, "unix:", false, 21 * kSecond);
  EXPECT_EQ(activity.callers(22 * kSecond).at(1).came_ns, 21 * kSecond);
  EXPECT_FALSE(activity.callers(22 * kSecond).at(0).watches);
}

TEST(Activity, EachAddressAndEachIdentityIsOne) {
  Activity activity;
  for (const char* peer : {"ipv4:192.0.2.7:1", "ipv4:192.0.2.7:2", "ipv4:192.0.2.8:1"}) {
    activity.Came(kAda, peer, false, 0);
  }
  activity.Came(kBob, "ipv4:192.0.2.7:1", false, 0);
  EXPECT_EQ(activity.callers(0).size(), 3u);
  // Two calls of the first run: one that ends does not end its presence.
  activity.Left(kAda, "ipv4:192.0.2.7:1", false, 0);
  EXPECT_EQ(activity.callers(10 * kHere).size(), 3u);
  activity.Left(kAda, "ipv4:192.0.2.7:2", false, 0);
  EXPECT_EQ(activity.callers(10 * kHere).size(), 2u);
}

TEST(Activity, TheNewestChangeOfEachThing) {
  Activity activity;
  activity.Changed("isovalue", "token ada", 1);
  activity.Changed("voxels", "token bob", 2);
  activity.Changed("isovalue", "local socket", 3);
  const auto changes = activity.changes();
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes[0].what, "isovalue");
  EXPECT_EQ(changes[0].by, "local socket");
  EXPECT_EQ(changes[0].time_ns, 3);
  EXPECT_EQ(changes[1].by, "token bob");
}

TEST(Activity, CallersByTheThousandTakeNoMore) {
  Activity activity;
  const int most = static_cast<int>(Activity::kMostCallers);
  for (int n = 0; n < 3 * most; ++n) {
    const std::string peer = "ipv4:192.0.2." + std::to_string(n) + ":1";
    EXPECT_EQ(activity.Came(kAda, peer, false, 0), n < most);
    if (n % 2 == 0) activity.Left(kAda, peer, false, 0);
    activity.Left(kBob, peer, true, 0);  // who never came
  }
  EXPECT_EQ(activity.callers(0).size(), Activity::kMostCallers);
  activity.Came(kBob, "unix:", false, 2 * kHere);
  EXPECT_LE(activity.callers(2 * kHere).size(), Activity::kMostCallers);
  EXPECT_EQ(activity.callers(2 * kHere).back().identity.name, kBob.name);
}

TEST(Activity, PeersInWords) {
  EXPECT_EQ(WhoInWords(kAda, "unix:"), "token ada");
  EXPECT_EQ(WhoInWords(kAda, "ipv6:%5B::1%5D:60286"), "token ada at ipv6:[::1]:60286");
}

TEST(Activity, FromManyThreads) {
  Activity activity;
  std::atomic<bool> done = false;
  std::thread reader([&] {
    while (!done) {
      EXPECT_LE(activity.callers(0).size(), 4u);
      EXPECT_LE(activity.changes().size(), 4u);
    }
  });
  std::vector<std::thread> writers;
  for (int n = 0; n < 4; ++n) {
    writers.emplace_back([&activity, n] {
      const std::string peer = "ipv4:192.0.2." + std::to_string(n) + ":1";
      for (int i = 0; i < 2000; ++i) {
        activity.Came(kAda, peer, true, i);
        activity.Changed(peer, "token ada", i);
        activity.Left(kAda, peer, true, i);
      }
    });
  }
  for (std::thread& writer : writers) writer.join();
  done = true;
  reader.join();
  for (const Activity::Caller& caller : activity.callers(2000)) EXPECT_FALSE(caller.watches);
}

}  // namespace
}  // namespace palpate
