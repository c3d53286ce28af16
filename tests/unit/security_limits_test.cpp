// What one identity may do, which connections go, and what of refusals is logged.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include <numeric>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "server/log/line_budget.h"
#include "server/security/connection_limits.h"
#include "server/security/identity_limits.h"

namespace palpate {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

int Taken(RateLimit& limit, std::int64_t now_ns, int tries) {
  int taken = 0;
  for (int n = 0; n < tries; ++n) taken += limit.Take(now_ns) ? 1 : 0;
  return taken;
}

TEST(RateLimit, GivesItsRateAndNoMoreThanItHolds) {
  RateLimit limit(10.0, 20.0);
  EXPECT_EQ(Taken(limit, kSecond, 100), 20);
  EXPECT_EQ(Taken(limit, 2 * kSecond, 100), 10);
  EXPECT_EQ(Taken(limit, 2 * kSecond, 100), 0);
  // A long rest saves no more than it holds; a clock that goes back gives nothing.
  EXPECT_EQ(Taken(limit, 1000 * kSecond, 100), 20);
  EXPECT_EQ(Taken(limit, kSecond, 100), 0);
  EXPECT_EQ(Taken(limit, 1000 * kSecond, 100), 0);
}

TEST(IdentityLimits, CountsEachIdentityAndKindByItself) {
  IdentityLimits limits({.calls_per_s = 3, .pose_streams = 2, .volume_streams = 1, .transfers = 1});
  const auto enters = [&](const char* who, CallKind kind) {
    return !limits.Enter(who, kind, 0, kSecond);
  };
  EXPECT_TRUE(enters("a", CallKind::kPoseStream));
  EXPECT_TRUE(enters("a", CallKind::kPoseStream));
  EXPECT_FALSE(enters("a", CallKind::kPoseStream));
  EXPECT_TRUE(enters("b", CallKind::kPoseStream));
  EXPECT_TRUE(enters("a", CallKind::kVolumeStream));
  EXPECT_FALSE(enters("a", CallKind::kVolumeStream));
  EXPECT_TRUE(enters("a", CallKind::kTransfer));
  EXPECT_FALSE(enters("a", CallKind::kTransfer));
  // What was refused holds no place.
  limits.Leave("a", CallKind::kPoseStream, 0);
  EXPECT_TRUE(enters("a", CallKind::kPoseStream));
  EXPECT_FALSE(enters("a", CallKind::kPoseStream));
  for (int n = 0; n < 3; ++n) EXPECT_TRUE(enters("a", CallKind::kCall));
  EXPECT_FALSE(enters("a", CallKind::kCall));
  for (int n = 0; n < 100; ++n) EXPECT_TRUE(enters("a", CallKind::kStop));
  for (int n = 0; n < IdentityLimits::kMostHands; ++n) EXPECT_TRUE(enters("a", CallKind::kHand));
  EXPECT_FALSE(enters("a", CallKind::kHand));
  EXPECT_NE(limits.Enter("a", CallKind::kPoseStream, 0, kSecond)->find("limits.pose_streams"),
            std::string::npos);
}

TEST(IdentityLimits, QuestionsMayTakeAQuarterOfAProcessor) {
  IdentityLimits limits({});
  const auto time_ns = [](double time_s) { return static_cast<std::int64_t>(1e9 * time_s); };
  const auto may = [&](const char* who, double time_s) {
    const bool works = !limits.MayWork(who, time_ns(time_s));
    EXPECT_EQ(!limits.Enter(who, CallKind::kQuestion, 0, time_ns(time_s)), works);
    return works;
  };
  const auto worked = [&](double seconds, double time_s) {
    limits.Worked("a", seconds, time_ns(time_s));
  };
  EXPECT_TRUE(may("a", 1.0));
  worked(0.4, 1.0);
  EXPECT_TRUE(may("a", 1.0));
  worked(0.6, 1.0);  // by those that were at work already
  EXPECT_FALSE(may("a", 1.0));
  EXPECT_TRUE(may("b", 1.0));
  EXPECT_TRUE(!limits.Enter("a", CallKind::kCall, 0, kSecond));
  EXPECT_TRUE(!limits.Enter("a", CallKind::kStop, 0, kSecond));
  EXPECT_FALSE(may("a", 2.9));
  EXPECT_TRUE(may("a", 3.1));
  worked(0.6, 100.0);  // what was not used is not saved
  EXPECT_FALSE(may("a", 100.0));
  worked(60.0, 100.0);  // and nobody is shut out for long
  EXPECT_TRUE(may("a", 102.1));
}

TEST(IdentityLimits, RequestsThatWaitAreSoManyBytes) {
  IdentityLimits limits({});
  const auto enters = [&](const char* who, std::size_t bytes) {
    return !limits.Enter(who, CallKind::kCall, bytes, kSecond);
  };
  constexpr std::size_t kMiB = 1 << 20;
  int entered = 0;
  for (int n = 0; n < 100; ++n) entered += enters("a", 3 * kMiB);
  EXPECT_EQ(entered, 42);  // of 128 MiB
  EXPECT_FALSE(enters("a", 2 * kMiB + 1));
  EXPECT_TRUE(enters("a", 2 * kMiB));
  EXPECT_FALSE(enters("a", 1));
  EXPECT_TRUE(enters("b", 3 * kMiB));
  limits.Leave("a", CallKind::kCall, 3 * kMiB);
  EXPECT_TRUE(enters("a", 3 * kMiB));
  EXPECT_FALSE(enters("a", 1));
  // Calls without a request are as many as come.
  for (int n = 0; n < 500; ++n) EXPECT_TRUE(enters("a", 0));
}

TEST(IdentityLimits, SamplesOfPosesAreForAllTogetherAndHalfForOneOverTheNetwork) {
  IdentityLimits limits({.pose_samples_per_s = 8000});
  const auto taken = [&](const char* who, bool is_local, int samples_per_s) {
    int streams = 0;
    for (int n = 0; n < 100; ++n) streams += !limits.EnterSamples(who, is_local, samples_per_s);
    return streams;
  };
  EXPECT_EQ(taken("token a", false, 1000), 4);
  const auto refusal = limits.EnterSamples("token a", false, 59);
  ASSERT_TRUE(refusal);
  for (const char* part : {"59", "4000", "limits.pose_samples_per_s"}) {
    EXPECT_NE(refusal->find(part), std::string::npos) << *refusal;
  }
  // Others still get in, and leave the operators' socket its share.
  EXPECT_EQ(taken("token b", false, 59), 67);
  EXPECT_EQ(taken("token d", false, 10), 4);
  EXPECT_EQ(taken("socket", true, 1000), 8);
  EXPECT_NE(limits.EnterSamples("token c", false, 59)->find("8000"), std::string::npos);
  // What ends makes room, for whoever comes.
  for (int n = 0; n < 4; ++n) limits.LeaveSamples("token a", 1000);
  EXPECT_EQ(taken("token a", false, 1000), 0);
  for (int n = 0; n < 8; ++n) limits.LeaveSamples("socket", 1000);
  EXPECT_EQ(taken("token a", false, 1000), 4);
  EXPECT_EQ(taken("socket", true, 1000), 8);
}

TEST(UnreadLimit, EachConnectionAndEachLowerSocketHasItsOwn) {
  UnreadLimit limit;
  const std::int64_t late = 10 * kSecond;
  const auto fill = [&](const std::string& peer) {
    int answers = 0;
    for (; answers < 2000 && !limit.IsAbove(peer, late); ++answers) limit.Waits(peer, 1000, 0);
    return answers;
  };
  const int most = fill("ipv4:10.0.0.7:1");
  EXPECT_EQ(most, 3);
  EXPECT_EQ(fill("ipv4:10.0.0.7:2"), most);
  EXPECT_EQ(fill(""), 2000) << "an operator's socket";
  EXPECT_GT(fill("viewer socket"), 900);
  EXPECT_LT(fill("editor socket"), 1100);
  // A burst that is sent within a second is no fault.
  EXPECT_FALSE(limit.IsAbove("ipv4:10.0.0.7:1", kSecond));
  // Whoever reads goes on.
  limit.Sent("ipv4:10.0.0.7:1", 1000);
  EXPECT_FALSE(limit.IsAbove("ipv4:10.0.0.7:1", late));
  limit.Waits("ipv4:10.0.0.7:1", 1000, late);
  EXPECT_FALSE(limit.IsAbove("ipv4:10.0.0.7:1", late + kSecond));
  EXPECT_TRUE(limit.IsAbove("ipv4:10.0.0.7:1", late + 2 * kSecond));
  EXPECT_TRUE(limit.IsAbove("ipv4:10.0.0.7:2", late));
}

TEST(UnreadLimit, ABurstOnManyConnectionsIsBoundedAtOnce) {
  UnreadLimit limit;
  std::size_t answers = 0;
  for (int connection = 0; connection < 900; ++connection) {
    const std::string peer = "ipv4:10.0.0.7:" + std::to_string(connection);
    for (int n = 0; n < 100 && !limit.IsAbove(peer, kSecond); ++n, ++answers) {
      limit.Waits(peer, 1000, kSecond);
    }
  }
  EXPECT_GT(answers, 3u * 900);  // each has its own bound
  EXPECT_LT(answers, 3u * 900 + UnreadLimit::kMostBytesOfAll / UnreadLimit::kCallBytes);
}

// What the shipped budget is made for.
TEST(UnreadLimit, WhoReadsNotEvenRefusalsIsDeafAndReadOnesDoNotCount) {
  UnreadLimit limit;
  const std::string peer = "ipv4:10.0.0.7:1";
  for (int n = 0; n < 1000; ++n) limit.Waits(peer, 1000, 0);
  for (int n = 0; n < 1000; ++n) {
    limit.Waits(peer, 0, 0, true);
    limit.Sent(peer, 0, true);
  }
  EXPECT_FALSE(limit.IsDeaf(peer, 0));
  for (std::size_t n = 0; n < UnreadLimit::kMostRefusals; ++n) limit.Waits(peer, 0, 0, true);
  EXPECT_FALSE(limit.IsDeaf(peer, 0)) << "a burst";
  EXPECT_TRUE(limit.IsDeaf(peer, 2 * kSecond));
  EXPECT_FALSE(limit.IsDeaf("ipv4:10.0.0.7:2", 2 * kSecond));
}

TEST(IdentityLimits, OneClientMayHaveEightStreamsAtFullRateAndSixtyFourViewers) {
  IdentityLimits limits({});
  for (int n = 0; n < 8; ++n) EXPECT_FALSE(limits.EnterSamples("a", false, 1000));
  for (int n = 0; n < 64; ++n) EXPECT_FALSE(limits.EnterSamples("a", false, 59));
}

TEST(LineBudget, AFloodIsAFewLinesThatSayHowMany) {
  LineBudget log;
  int lines = 0;
  std::uint64_t left_out = 0;
  // Another port at each connection; 1000 per second for a minute.
  for (int n = 0; n < 60'000; ++n) {
    const auto take = log.Take("ipv4:10.0.0.7:" + std::to_string(n), kSecond + n * kSecond / 1000);
    if (!take) continue;
    ++lines;
    left_out += *take;
  }
  EXPECT_GE(lines, 23);
  EXPECT_LE(lines, 28);
  EXPECT_GT(left_out, 40'000u);
  // It hides nobody else.
  EXPECT_TRUE(log.Take("ipv4:10.0.0.8:1", 61 * kSecond));
}

TEST(LineBudget, ManyAddressesStayFewLines) {
  LineBudget log;
  int lines = 0;
  for (int n = 0; n < 100'000; ++n) {
    lines += log.Take("ipv6:%5B2001:db8::" + std::to_string(n) + "%5D:1", kSecond) ? 1 : 0;
  }
  EXPECT_LE(lines, static_cast<int>(LineBudget::kMostClients) + 20);
}

TEST(LineBudget, AnAddressHasNoPort) {
  EXPECT_EQ(AddressOf("ipv4:10.0.0.7:51312"), "ipv4:10.0.0.7");
  EXPECT_EQ(AddressOf("ipv6:%5B::1%5D:51312"), "ipv6:%5B::1%5D");
  EXPECT_EQ(AddressOf("unix:"), "unix:");
}

sockaddr_storage Address(const std::string& text) {
  sockaddr_storage address{};
  const bool is_v6 = text.find(':') != std::string::npos;
  address.ss_family = is_v6 ? AF_INET6 : AF_INET;
  void* const bytes = is_v6
                          ? static_cast<void*>(&reinterpret_cast<sockaddr_in6&>(address).sin6_addr)
                          : static_cast<void*>(&reinterpret_cast<sockaddr_in&>(address).sin_addr);
  EXPECT_EQ(inet_pton(address.ss_family, text.c_str(), bytes), 1) << text;
  return address;
}

std::string From(const std::string& address) { return PrefixOf(Address(address)); }

TEST(ConnectionLimits, AddressesCountByTheirPrefix) {
  EXPECT_EQ(PrefixOf(Address("10.0.0.7")), "10.0.0.7");
  EXPECT_EQ(PrefixOf(Address("::ffff:10.0.0.7")), "10.0.0.7");
  EXPECT_EQ(PrefixOf(Address("2001:db8:0:1:2:3:4:5")), "2001:db8:0:1::/64");
  EXPECT_EQ(PrefixOf(Address("2001:db8:0:1::6")), PrefixOf(Address("2001:db8:0:1:2:3:4:5")));
  EXPECT_NE(PrefixOf(Address("2001:db8:0:2::6")), PrefixOf(Address("2001:db8:0:1::6")));
}

// The newcomer's address is the first and the last in any order of text.
TEST(ConnectionLimits, OfManyPrefixesWithOneEachTheOldestGoes) {
  for (const std::string newcomer : {"2001:db8::1", "2001:db8:ffff::1", "10.0.0.7"}) {
    std::vector<std::string> all;
    for (std::size_t n = 1; n <= kMostStrangers; ++n) {
      all.push_back(From("2001:db8:" + std::to_string(100 + n % 7 * 100 + n) + "::1"));
    }
    EXPECT_TRUE(CutsAmong(all).empty());
    all.push_back(From(newcomer));
    const auto cuts = CutsAmong(all);
    ASSERT_EQ(cuts.size(), 1u) << newcomer;
    EXPECT_EQ(cuts[0], 0u) << newcomer;
  }
}

TEST(ConnectionLimits, ManyAddressesOfOnePrefixTakeOnlyItsOwnPlaces) {
  std::vector<std::string> all{From("2001:db8:0:9::1"), From("10.0.0.7")};
  for (std::size_t n = 1; n <= 3 * kMostStrangers; ++n) {
    all.push_back(From("2001:db8:0:1::" + std::to_string(n)));
  }
  all.push_back(From("2001:db8:0:2::1"));
  const std::vector<std::size_t> cut = CutsAmong(all);
  std::vector<std::size_t> oldest(all.size() - kMostStrangers);
  std::iota(oldest.begin(), oldest.end(), std::size_t{2});
  EXPECT_EQ(cut, oldest);
}

TEST(ConnectionLimits, WhateverComesTheRestKeepsWithinTheBound) {
  std::mt19937_64 random(20261121);
  for (int round = 0; round < 2000; ++round) {
    std::vector<std::string> all(random() % 200);
    for (std::string& one : all) one = std::string(1, static_cast<char>('a' + random() % 5));
    const std::vector<std::size_t> cuts = CutsAmong(all);
    const std::set<std::size_t> different(cuts.begin(), cuts.end());
    ASSERT_EQ(different.size(), cuts.size());
    ASSERT_TRUE(different.empty() || *different.rbegin() < all.size());
    ASSERT_EQ(all.size() - cuts.size(), std::min(all.size(), kMostStrangers));
  }
}

}  // namespace
}  // namespace palpate
