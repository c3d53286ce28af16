// The pauses between attempts to connect.
#include "client/sdk/backoff.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <set>

namespace palpate::client {
namespace {

TEST(Backoff, DoublesUpToTheLongestAndBeginsAnewAfterASuccess) {
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Backoff backoff(seed);
    for (const int longest_ms : {100, 200, 400, 800, 1600, 3200, 5000, 5000, 5000}) {
      const auto pause_ms = backoff.Next().count();
      EXPECT_LE(pause_ms, longest_ms);
      EXPECT_GT(pause_ms, longest_ms / 2);
    }
    for (int n = 0; n < 100; ++n) {
      const auto pause = backoff.Next();
      ASSERT_LE(pause, Backoff::kLongest);
      ASSERT_GT(pause, Backoff::kLongest / 2);
    }
    backoff.Reset();
    EXPECT_LE(backoff.Next(), Backoff::kFirst);
  }
}

TEST(Backoff, ManyClientsDoNotComeBackAtOnce) {
  std::set<std::int64_t> pauses_ms;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Backoff backoff(seed);
    for (int n = 0; n < 8; ++n) backoff.Next();
    pauses_ms.insert(backoff.Next().count());
  }
  EXPECT_GT(pauses_ms.size(), 150u);
}

}  // namespace
}  // namespace palpate::client
