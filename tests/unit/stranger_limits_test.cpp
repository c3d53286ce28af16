#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "server/security/stranger_limits.h"

namespace palpate {
namespace {

constexpr std::int64_t kMiB = 1 << 20;

std::vector<StrangerConnection> Strangers(std::size_t count, const std::string& address,
                                          std::int64_t bytes) {
  return std::vector<StrangerConnection>(count, {address, bytes});
}

TEST(StrangerLimits, AClientWithAFullFirstCallIsLeftAlone) {
  EXPECT_TRUE(CutsAmongStrangers({}).empty());
  EXPECT_TRUE(CutsAmongStrangers(Strangers(1, "a", 5 * kMiB)).empty());
  EXPECT_TRUE(CutsAmongStrangers(Strangers(kMostStrangers, "a", kMiB)).empty());
}

TEST(StrangerLimits, WhoSendsTooMuchGoes) {
  auto all = Strangers(3, "a", 1000);
  all[1].received_bytes = kMostBytesOfStranger + 1;
  const auto cuts = CutsAmongStrangers(all);
  ASSERT_EQ(cuts.size(), 1u);
  EXPECT_EQ(cuts[0].connection, 1u);
  EXPECT_TRUE(cuts[0].sent_too_much);
}

TEST(StrangerLimits, OfThoseThatSendTooMuchTogetherTheGreatestGo) {
  auto all = Strangers(12, "a", 6 * kMiB);
  all[7].received_bytes = 7 * kMiB;
  all.push_back({"b", 1000});
  const auto cuts = CutsAmongStrangers(all);
  ASSERT_EQ(cuts.size(), 2u);
  EXPECT_EQ(cuts[0].connection, 7u);
  EXPECT_LT(cuts[1].connection, 12u);
}

TEST(StrangerLimits, OfTooManyTheOldestOfTheAddressWithMostGoes) {
  auto all = Strangers(1, "b", 1000);
  const auto flood = Strangers(kMostStrangers + 1, "a", 1000);
  all.insert(all.end(), flood.begin(), flood.end());
  const auto cuts = CutsAmongStrangers(all);
  ASSERT_EQ(cuts.size(), 2u);
  EXPECT_EQ(cuts[0].connection, 1u);
  EXPECT_EQ(cuts[1].connection, 2u);
  EXPECT_FALSE(cuts[0].sent_too_much);
}

TEST(StrangerLimits, WhateverComesTheRestKeepsWithinTheBounds) {
  std::mt19937_64 random(20261121);
  for (int round = 0; round < 2000; ++round) {
    std::vector<StrangerConnection> all(random() % 200);
    for (StrangerConnection& one : all) {
      one = {std::string(1, static_cast<char>('a' + random() % 5)),
             static_cast<std::int64_t>(random() % (std::uint64_t{1} << (random() % 26)))};
    }
    std::vector<bool> is_cut(all.size(), false);
    for (const StrangerCut& cut : CutsAmongStrangers(all)) {
      ASSERT_LT(cut.connection, all.size());
      ASSERT_FALSE(is_cut[cut.connection]);
      is_cut[cut.connection] = true;
    }
    std::size_t count = 0;
    std::int64_t bytes = 0;
    for (std::size_t n = 0; n < all.size(); ++n) {
      if (is_cut[n]) continue;
      ++count;
      bytes += all[n].received_bytes;
      ASSERT_LE(all[n].received_bytes, kMostBytesOfStranger);
    }
    ASSERT_LE(count, kMostStrangers);
    ASSERT_LE(bytes, kMostBytesOfStrangers);
  }
}

}  // namespace
}  // namespace palpate
