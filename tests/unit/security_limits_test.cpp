// Rates, counts per identity, and what of refusals is logged.
#include <gtest/gtest.h>

#include <string>

#include "server/security/identity_limits.h"
#include "server/security/refusal_log.h"

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
    return !limits.Enter(who, kind, kSecond);
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
  limits.Leave("a", CallKind::kPoseStream);
  EXPECT_TRUE(enters("a", CallKind::kPoseStream));
  EXPECT_FALSE(enters("a", CallKind::kPoseStream));
  for (int n = 0; n < 3; ++n) EXPECT_TRUE(enters("a", CallKind::kCall));
  EXPECT_FALSE(enters("a", CallKind::kCall));
  for (int n = 0; n < 100; ++n) EXPECT_TRUE(enters("a", CallKind::kStop));
  EXPECT_NE(limits.Enter("a", CallKind::kPoseStream, kSecond)->find("limits.pose_streams"),
            std::string::npos);
}

TEST(IdentityLimits, CallsThatLastAreSoManyAtATime) {
  IdentityLimits limits({});
  int entered = 0;
  for (int n = 0; n < 500; ++n) entered += !limits.Enter("a", CallKind::kCall, kSecond);
  EXPECT_EQ(entered, 128);
  EXPECT_FALSE(limits.Enter("a", CallKind::kStop, kSecond));
  EXPECT_FALSE(limits.Enter("b", CallKind::kCall, kSecond));
  limits.Leave("a", CallKind::kCall);
  EXPECT_FALSE(limits.Enter("a", CallKind::kCall, kSecond));
  EXPECT_TRUE(limits.Enter("a", CallKind::kCall, kSecond));
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
  for (const char* part : {"59 samples per second", "4000 of the 4000 for one client",
                           "ask for a lower rate", "end other", "limits.pose_samples_per_s"}) {
    EXPECT_NE(refusal->find(part), std::string::npos) << *refusal;
  }
  EXPECT_EQ(refusal->find('\n'), std::string::npos);
  // Others still get in, and the socket has what is left.
  EXPECT_EQ(taken("token b", false, 59), 67);
  EXPECT_EQ(taken("socket", true, 10), 4);
  EXPECT_NE(limits.EnterSamples("token c", false, 59)->find("of the 8000 for all clients"),
            std::string::npos);
  // What ends makes room, for whoever comes.
  for (int n = 0; n < 4; ++n) limits.LeaveSamples("token a", 1000);
  EXPECT_EQ(taken("socket", true, 1000), 4);
  EXPECT_EQ(taken("token a", false, 1000), 0);
  for (int n = 0; n < 67; ++n) limits.LeaveSamples("token b", 59);
  for (int n = 0; n < 4; ++n) limits.LeaveSamples("socket", 1000);
  for (int n = 0; n < 4; ++n) limits.LeaveSamples("socket", 10);
  EXPECT_EQ(taken("socket", true, 1000), 8);
}

// What the shipped budget is made for.
TEST(IdentityLimits, OneClientMayHaveEightStreamsAtFullRateAndSixtyFourViewers) {
  IdentityLimits limits({});
  for (int n = 0; n < 8; ++n) EXPECT_FALSE(limits.EnterSamples("a", false, 1000));
  for (int n = 0; n < 64; ++n) EXPECT_FALSE(limits.EnterSamples("a", false, 59));
}

TEST(RefusalLog, AFloodIsAFewLinesThatSayHowMany) {
  RefusalLog log;
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

TEST(RefusalLog, ManyAddressesStayFewLines) {
  RefusalLog log;
  int lines = 0;
  for (int n = 0; n < 100'000; ++n) {
    lines += log.Take("ipv6:%5B2001:db8::" + std::to_string(n) + "%5D:1", kSecond) ? 1 : 0;
  }
  EXPECT_LE(lines, static_cast<int>(RefusalLog::kMostPeers) + 20);
}

TEST(RefusalLog, AnAddressHasNoPort) {
  EXPECT_EQ(AddressOf("ipv4:10.0.0.7:51312"), "ipv4:10.0.0.7");
  EXPECT_EQ(AddressOf("ipv6:%5B::1%5D:51312"), "ipv6:%5B::1%5D");
  EXPECT_EQ(AddressOf("unix:"), "unix:");
}

}  // namespace
}  // namespace palpate
