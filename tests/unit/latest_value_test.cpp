#include "server/realtime/latest_value.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <thread>

namespace palpate {
namespace {

struct Value {
  std::array<std::uint64_t, 16> copies{};
  static Value Of(std::uint64_t number) {
    Value value;
    value.copies.fill(number);
    return value;
  }
};

TEST(LatestValue, BeginsWithTheFirst) {
  LatestValue<int> value(7);
  bool is_new = true;
  EXPECT_EQ(value.Read(is_new), 7);
  EXPECT_FALSE(is_new);
}

TEST(LatestValue, GivesTheNewestAgainAndAgain) {
  LatestValue<int> value;
  bool is_new = false;
  for (int i = 1; i < 100; ++i) {
    for (int k = 0; k < i % 4; ++k) value.Write(-1);  // lost unread
    value.Write(i);
    EXPECT_EQ(value.Read(is_new), i);
    EXPECT_TRUE(is_new);
    EXPECT_EQ(value.Read(is_new), i);
    EXPECT_FALSE(is_new);
  }
}

TEST(LatestValue, StaysAsItIsUntilTheNextRead) {
  LatestValue<int> value;
  value.Write(1);
  const int& read = value.Read();
  for (int i = 2; i < 10; ++i) value.Write(i);
  EXPECT_EQ(read, 1);
  EXPECT_EQ(value.Read(), 9);
}

TEST(LatestValue, BetweenThreadsIsWholeAndNeverGoesBackwards) {
  constexpr std::uint64_t kWrites = 30'000;
  LatestValue<Value> value;
  std::atomic<std::uint64_t> written{0};
  std::thread writer([&] {
    for (std::uint64_t i = 1; i <= kWrites; ++i) {
      value.Write(Value::Of(i));
      written.store(i, std::memory_order_release);
      if (i % 64 == 0) std::this_thread::yield();
    }
  });
  std::uint64_t last = 0;
  while (last < kWrites) {
    const std::uint64_t at_least = written.load(std::memory_order_acquire);
    bool is_new = false;
    const Value& read = value.Read(is_new);
    const std::uint64_t number = read.copies[0];
    for (const std::uint64_t copy : read.copies) EXPECT_EQ(copy, number);  // not torn
    EXPECT_GE(number, last);
    EXPECT_GE(number, at_least);
    EXPECT_EQ(is_new, number != last);
    last = number;
    if (number == at_least) std::this_thread::yield();
  }
  writer.join();
}

}  // namespace
}  // namespace palpate
