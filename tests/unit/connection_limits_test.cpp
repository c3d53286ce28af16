#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "server/security/connection_limits.h"

namespace palpate {
namespace {

constexpr std::int64_t kMiB = 1 << 20;

std::vector<BoundedConnection> Strangers(std::size_t count, const std::string& prefix,
                                         std::int64_t bytes) {
  return std::vector<BoundedConnection>(count, {prefix, bytes});
}

std::vector<std::size_t> CutOff(const std::vector<BoundedConnection>& all) {
  std::vector<std::size_t> cut;
  for (const ConnectionCut& one : CutsAmong(all, kStrangerBounds)) cut.push_back(one.connection);
  return cut;
}

using Numbers = std::vector<std::size_t>;

TEST(ConnectionLimits, AClientWithAFullFirstCallIsLeftAlone) {
  EXPECT_EQ(CutOff({}), Numbers());
  EXPECT_EQ(CutOff(Strangers(1, "a", 5 * kMiB)), Numbers());
  EXPECT_EQ(CutOff(Strangers(kStrangerBounds.connections, "a", kMiB)), Numbers());
}

TEST(ConnectionLimits, WhoSendsTooMuchGoes) {
  auto all = Strangers(3, "a", 1000);
  all[1].bytes = kStrangerBounds.bytes_of_one + 1;
  EXPECT_EQ(CutOff(all), Numbers{1});
  EXPECT_TRUE(CutsAmong(all, kStrangerBounds)[0].sent_too_much);
}

TEST(ConnectionLimits, OfThoseThatSendTooMuchTogetherTheGreatestGo) {
  auto all = Strangers(12, "a", 6 * kMiB);
  all[7].bytes = 7 * kMiB;
  all.push_back({"b", 1000});
  const auto cut = CutOff(all);
  ASSERT_EQ(cut.size(), 2u);
  EXPECT_EQ(cut[0], 7u);
  EXPECT_LT(cut[1], 12u);
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

BoundedConnection From(const std::string& address, std::int64_t bytes = 1000) {
  return {PrefixOf(Address(address)), bytes};
}

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
    std::vector<BoundedConnection> all;
    for (std::size_t n = 1; n <= kStrangerBounds.connections; ++n) {
      all.push_back(From("2001:db8:" + std::to_string(100 + n % 7 * 100 + n) + "::1"));
    }
    EXPECT_EQ(CutOff(all), Numbers());
    all.push_back(From(newcomer));
    EXPECT_EQ(CutOff(all), Numbers{0}) << newcomer;
  }
}

TEST(ConnectionLimits, ManyAddressesOfOnePrefixTakeOnlyItsOwnPlaces) {
  std::vector<BoundedConnection> all{From("2001:db8:0:9::1"), From("10.0.0.7")};
  for (std::size_t n = 1; n <= 3 * kStrangerBounds.connections; ++n) {
    all.push_back(From("2001:db8:0:1::" + std::to_string(n)));
  }
  all.push_back(From("2001:db8:0:2::1"));
  Numbers oldest(all.size() - kStrangerBounds.connections);
  std::iota(oldest.begin(), oldest.end(), std::size_t{2});
  EXPECT_EQ(CutOff(all), oldest);
}

TEST(ConnectionLimits, OfThoseThatSendTooMuchTogetherThePrefixThatSentMostLoses) {
  std::vector<BoundedConnection> all;
  for (int n = 1; n <= 63; ++n) {
    all.push_back(From("2001:db8:0:1::" + std::to_string(n), kMiB));
  }
  all.push_back(From("2001:db8:0:2::1", 4 * kMiB));  // a large first call
  const auto cut = CutOff(all);
  EXPECT_EQ(cut.size(), 3u);
  for (const std::size_t one : cut) EXPECT_LT(one, 63u);
}

TEST(ConnectionLimits, OfTooManyTheOldestOfTheAddressWithMostGoes) {
  auto all = Strangers(1, "b", 1000);
  const auto flood = Strangers(kStrangerBounds.connections + 1, "a", 1000);
  all.insert(all.end(), flood.begin(), flood.end());
  EXPECT_EQ(CutOff(all), (Numbers{1, 2}));
  EXPECT_FALSE(CutsAmong(all, kStrangerBounds)[0].sent_too_much);
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
    for (const std::size_t cut : CutOff(all)) {
      ASSERT_LT(cut, all.size());
      ASSERT_FALSE(is_cut[cut]);
      is_cut[cut] = true;
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

}  // namespace
}  // namespace palpate
