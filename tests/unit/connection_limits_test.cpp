#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "server/security/connection_limits.h"

namespace palpate {
namespace {

constexpr std::int64_t kMiB = 1 << 20;

std::vector<BoundedConnection> Strangers(std::size_t count, const std::string& address,
                                         std::int64_t bytes) {
  return std::vector<BoundedConnection>(count, {address, bytes});
}

TEST(ConnectionLimits, AClientWithAFullFirstCallIsLeftAlone) {
  EXPECT_TRUE(CutsAmong({}, kStrangerBounds).empty());
  EXPECT_TRUE(CutsAmong(Strangers(1, "a", 5 * kMiB), kStrangerBounds).empty());
  EXPECT_TRUE(
      CutsAmong(Strangers(kStrangerBounds.connections, "a", kMiB), kStrangerBounds).empty());
}

TEST(ConnectionLimits, WhoSendsTooMuchGoes) {
  auto all = Strangers(3, "a", 1000);
  all[1].bytes = kStrangerBounds.bytes_of_one + 1;
  const auto cuts = CutsAmong(all, kStrangerBounds);
  ASSERT_EQ(cuts.size(), 1u);
  EXPECT_EQ(cuts[0].connection, 1u);
  EXPECT_TRUE(cuts[0].sent_too_much);
}

TEST(ConnectionLimits, OfThoseThatSendTooMuchTogetherTheGreatestGo) {
  auto all = Strangers(12, "a", 6 * kMiB);
  all[7].bytes = 7 * kMiB;
  all.push_back({"b", 1000});
  const auto cuts = CutsAmong(all, kStrangerBounds);
  ASSERT_EQ(cuts.size(), 2u);
  EXPECT_EQ(cuts[0].connection, 7u);
  EXPECT_LT(cuts[1].connection, 12u);
}

TEST(ConnectionLimits, OfTooManyTheOldestOfTheAddressWithMostGoes) {
  auto all = Strangers(1, "b", 1000);
  const auto flood = Strangers(kStrangerBounds.connections + 1, "a", 1000);
  all.insert(all.end(), flood.begin(), flood.end());
  const auto cuts = CutsAmong(all, kStrangerBounds);
  ASSERT_EQ(cuts.size(), 2u);
  EXPECT_EQ(cuts[0].connection, 1u);
  EXPECT_EQ(cuts[1].connection, 2u);
  EXPECT_FALSE(cuts[0].sent_too_much);
}

TEST(ConnectionLimits, WhateverComesTheRestKeepsWithinTheBounds) {
  std::mt19937_64 random(20261121);
  for (int round = 0; round < 2000; ++round) {
    std::vector<BoundedConnection> all(random() % 200);
    for (BoundedConnection& one : all) {
      one = {std::string(1, static_cast<char>('a' + random() % 5)),
             static_cast<std::int64_t>(random() % (std::uint64_t{1} << (random() % 26)))};
    }
    std::vector<bool> is_cut(all.size(), false);
    for (const ConnectionCut& cut : CutsAmong(all, kStrangerBounds)) {
      ASSERT_LT(cut.connection, all.size());
      ASSERT_FALSE(is_cut[cut.connection]);
      is_cut[cut.connection] = true;
    }
    std::size_t count = 0;
    std::int64_t bytes = 0;
    for (std::size_t n = 0; n < all.size(); ++n) {
      if (is_cut[n]) continue;
      ++count;
      bytes += all[n].bytes;
      ASSERT_LE(all[n].bytes, kStrangerBounds.bytes_of_one);
    }
    ASSERT_LE(count, kStrangerBounds.connections);
    ASSERT_LE(bytes, kStrangerBounds.bytes_of_all);
  }
}

constexpr std::int64_t kSecondNs = 1'000'000'000;

TEST(UnreadBytes, RiseByWhatNobodyReads) {
  UnreadBytes unread;
  EXPECT_EQ(unread.Update(2000, 0, {}, kSecondNs), 2000);
  EXPECT_EQ(unread.Update(2000 + kMiB, 0, {}, kSecondNs), 2000 + kMiB);
}

TEST(UnreadBytes, FallAgainWhenItIsRead) {
  UnreadBytes unread;
  EXPECT_GT(unread.Update(4 * kMiB + 500, 0, {}, kSecondNs), 4 * kMiB);
  EXPECT_EQ(unread.Update(4 * kMiB + 500, 0, {.calls = 1, .messages = 1, .message_bytes = 4 * kMiB},
                          kSecondNs),
            0);
}

// Each leaves what was under way: windows of some MiB at most.
TEST(UnreadBytes, UploadsThatAreRefusedNowAndThenAreForgiven) {
  UnreadBytes unread;
  std::int64_t bytes = 0;
  for (std::int64_t hour = 1; hour <= 1000; ++hour) {
    bytes = unread.Update(hour * 4 * kMiB, 0, {.calls = hour}, hour * 3600 * kSecondNs);
  }
  EXPECT_LT(bytes, kKnownBounds.bytes_of_one / 2);
}

// What was measured of a stream at 1 kHz for a year, of downloads and of calls.
TEST(UnreadBytes, ClientsThatOnlyCallAreNeverCutOff) {
  UnreadBytes unread;
  ReadBytes read;
  std::int64_t received = 1000, acknowledged = 2000;
  for (std::int64_t minute = 1; minute <= 525'600; ++minute) {
    read.calls += 10;
    read.messages += 10 + 60'000 / 2;
    read.message_bytes += 10 * 20 + 60'000 / 2 * 2;
    read.answers += 10 + 60'000;
    received += 10 * 177 + 60'000 * 89 + 2 * kMiB / 1700;
    acknowledged += 60'000 * 372 + 2 * kMiB;
    ASSERT_LT(unread.Update(received, acknowledged, read, minute * 60 * kSecondNs), kMiB) << minute;
  }
}

TEST(UnreadBytes, NothingIsSavedUp) {
  UnreadBytes unread;
  const ReadBytes read{.calls = 1'000'000, .answers = 100'000'000};
  EXPECT_EQ(unread.Update(1000, 1 << 30, read, 3600 * kSecondNs), 0);
  EXPECT_EQ(unread.Update(1000 + kMiB, 1 << 30, read, 3600 * kSecondNs), kMiB);
}

TEST(UnreadBytes, WhatIsSentInSmallPiecesCountsToo) {
  UnreadBytes unread;
  std::int64_t bytes = 0;
  // 100 kB a second for an hour, beside idle calls.
  for (std::int64_t second = 1; second <= 3600; ++second) {
    bytes = unread.Update(second * 100'000, 0, {.calls = second}, second * kSecondNs);
  }
  EXPECT_GT(bytes, kKnownBounds.bytes_of_one);
}

}  // namespace
}  // namespace palpate
