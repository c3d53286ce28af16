// Volumes that nobody shows any more: who frees them, and until when they count.
#include "server/store/retired_volumes.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "server/volume/leaf.h"
#include "tests/support/patience.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLong{60'000};

// Says which thread freed it.
struct Tracked {
  explicit Tracked(std::atomic<std::thread::id>& by) : freed_by(by) {}
  ~Tracked() { freed_by = std::this_thread::get_id(); }
  std::atomic<std::thread::id>& freed_by;
};

using Leaves = std::vector<LeafPtr>;

std::shared_ptr<const Leaves> MakeLeaves(int count) {
  Leaves leaves;
  for (int n = 0; n < count; ++n) leaves.push_back(Leaf::Of(LeafType::kFloat, Brick{}));
  return std::make_shared<const Leaves>(std::move(leaves));
}

TEST(RetiredVolumes, OneThreadFreesWhatNobodyElseHolds) {
  std::atomic<std::thread::id> freed_by{};
  std::atomic<int> collected = 0;
  RetiredVolumes retired([&] { ++collected; });
  auto held = std::make_shared<const Tracked>(freed_by);
  retired.Add(held);
  // Also while nobody adds anything.
  EXPECT_TRUE(test::Eventually([&] { return collected >= 2; }));
  EXPECT_EQ(freed_by.load(), std::thread::id());
  held.reset();
  EXPECT_EQ(freed_by.load(), std::thread::id());
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
  EXPECT_NE(freed_by.load(), std::this_thread::get_id());
  retired.Add(nullptr);
  retired.WaitForFreed(kLong);
}

TEST(RetiredVolumes, NobodyWaitsLongForWhatOthersKeep) {
  RetiredVolumes retired([] {});
  const auto kept = MakeLeaves(10);
  retired.Add(kept);
  retired.WaitForFreed(std::chrono::hours(1));
  // What others let go is freed though.
  std::atomic<std::thread::id> freed_by{};
  retired.Add(std::make_shared<const Tracked>(freed_by));
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
}

TEST(RetiredVolumes, WhatIsHandedOverTwiceIsFreedToo) {
  std::atomic<std::thread::id> freed_by{};
  RetiredVolumes retired([] {});
  auto held = std::make_shared<const Tracked>(freed_by);
  retired.Add(held);
  retired.Add(held);
  retired.WaitForFreed(milliseconds(20));
  retired.Add(std::move(held));
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
}

TEST(RetiredVolumes, WhatTheServoLeavesIsFreedToo) {
  std::atomic<std::thread::id> freed_by{};
  std::shared_ptr<const Tracked> with_servo = std::make_shared<const Tracked>(freed_by);
  std::atomic<bool> servo_left = false;
  RetiredVolumes retired([&] {
    if (servo_left) with_servo.reset();
  });
  retired.Add(with_servo);
  retired.WaitForFreed(milliseconds(20));
  servo_left = true;
  retired.WaitForFreed(kLong);
  EXPECT_NE(freed_by.load(), std::thread::id());
}

TEST(RetiredVolumes, BricksCountUntilTheirMemoryIsGivenBack) {
  const std::uint64_t before = LiveBrickBytes();
  constexpr int kCount = 8192;  // 18 MiB
  RetiredVolumes retired([] {});
  retired.Add(MakeLeaves(kCount));
  retired.WaitForFreed(kLong);
  EXPECT_EQ(LiveBrickBytes(), before);
  // Those that others freed.
  retired.NoteFreed(12345);
  EXPECT_GE(LiveBrickBytes() + 12345, before);
  retired.WaitForFreed(kLong);
  EXPECT_EQ(LiveBrickBytes(), before);
}

TEST(RetiredVolumes, TheEndLeavesNothing) {
  const std::uint64_t before = LiveBrickBytes();
  {
    RetiredVolumes retired([] {});
    const auto held = MakeLeaves(10);
    retired.Add(held);
    retired.Add(MakeLeaves(5000));
    retired.NoteFreed(99);
  }
  EXPECT_EQ(LiveBrickBytes(), before);
}

TEST(RetiredVolumes, ManyThreadsHandOver) {
  const std::uint64_t before = LiveBrickBytes();
  RetiredVolumes retired([] {});
  std::vector<std::thread> threads;
  for (int n = 0; n < 4; ++n) {
    threads.emplace_back([&] {
      std::shared_ptr<const Leaves> shown = MakeLeaves(3);
      for (int round = 0; round < 200; ++round) {
        retired.Add(std::exchange(shown, MakeLeaves(3)));
        if (round % 50 == 0) retired.WaitForFreed(milliseconds(5));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  retired.WaitForFreed(kLong);
  EXPECT_EQ(LiveBrickBytes(), before);
}

TEST(TidyBrickWork, CountsWhatItsThreadFrees) {
  const std::uint64_t before = LiveBrickBytes();
  RetiredVolumes retired([] {});
  {
    const TidyBrickWork work(retired);
    auto leaves = MakeLeaves(100);
    const std::uint64_t made = 100 * Leaf::Bytes(LeafType::kFloat);
    EXPECT_EQ(work.made_bytes(), made);
    std::thread([] { MakeLeaves(7); }).join();
    leaves.reset();
    EXPECT_EQ(work.made_bytes(), 0u);
    EXPECT_EQ(work.most_bytes(), made);
    EXPECT_EQ(LiveBrickBytes(), before);
  }
  retired.WaitForFreed(kLong);
  EXPECT_EQ(LiveBrickBytes(), before);
}

}  // namespace
}  // namespace palpate
