// The newest tick, its forces, and waiting for a tick.
#include "server/samples/force_watch.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace palpate {
namespace {

using std::chrono::milliseconds;

TickSample Sample(std::uint64_t tick, ForceState state, ForceReason reason = ForceReason::kNone) {
  TickSample sample;
  sample.tick = tick;
  sample.force_state = state;
  sample.force_reason = reason;
  sample.force_limit_n = 0.5 + static_cast<double>(tick);
  return sample;
}

TEST(ForceWatch, KnowsNothingBeforeTheFirstTick) {
  const LastTickBoard board;
  const ForceWatch watch(board);
  EXPECT_FALSE(watch.newest());
  EXPECT_FALSE(watch.WaitForTick(0, milliseconds(1)));
}

TEST(ForceWatch, TellsTheNewestTickAndSinceWhenItIsSo) {
  LastTickBoard board;
  const ForceWatch watch(board);
  board.Tell(Sample(7, ForceState::kOn));
  board.Tell(Sample(9, ForceState::kOn));
  ASSERT_TRUE(watch.newest());
  EXPECT_EQ(watch.newest()->tick, 9u);
  EXPECT_EQ(watch.newest()->since_tick, 7u);
  EXPECT_EQ(watch.newest()->limit_n, 9.5);
  board.Tell(Sample(10, ForceState::kStopped, ForceReason::kStopButton));
  EXPECT_EQ(watch.newest()->since_tick, 10u);
  // Another reason is another story.
  board.Tell(Sample(12, ForceState::kStopped, ForceReason::kStopCall));
  EXPECT_EQ(watch.newest()->since_tick, 12u);
  EXPECT_EQ(watch.newest()->state, ForceState::kStopped);
  EXPECT_EQ(watch.newest()->reason, ForceReason::kStopCall);
}

TEST(ForceWatch, AnOldTickIsNoWait) {
  LastTickBoard board;
  const ForceWatch watch(board);
  board.Tell(Sample(100, ForceState::kOff, ForceReason::kOperator));
  for (const std::uint64_t tick : {0u, 99u, 100u}) {
    ASSERT_TRUE(watch.WaitForTick(tick, milliseconds(0)));
    EXPECT_EQ(watch.WaitForTick(tick, milliseconds(0))->tick, 100u);
  }
  EXPECT_FALSE(watch.WaitForTick(101, milliseconds(0)));
  EXPECT_FALSE(watch.WaitForTick(101, milliseconds(5)));
}

TEST(ForceWatch, ManyWaitEachForItsTick) {
  LastTickBoard board;
  const ForceWatch watch(board);
  constexpr std::uint64_t kTicks = 2000;
  std::atomic<int> wrong{0};
  std::vector<std::thread> waiters;
  for (std::uint64_t step = 1; step <= 8; ++step) {
    waiters.emplace_back([&, step] {
      for (std::uint64_t tick = step; tick < kTicks; tick += step * 10) {
        const auto seen = watch.WaitForTick(tick, std::chrono::seconds(60));
        // Never an older one, and its parts belong together.
        wrong += !seen || seen->tick < tick || seen->limit_n != 0.5 + seen->tick ||
                 seen->since_tick > seen->tick ||
                 (seen->state == ForceState::kOn) != (seen->tick / 50 % 2 == 0);
      }
    });
  }
  for (std::uint64_t tick = 0; tick < kTicks; ++tick) {
    board.Tell(Sample(tick, tick / 50 % 2 == 0 ? ForceState::kOn : ForceState::kHeld));
    if (tick % 100 == 0) std::this_thread::sleep_for(milliseconds(1));
  }
  for (std::thread& waiter : waiters) waiter.join();
  EXPECT_EQ(wrong, 0);
}

TEST(LastTick, KnowsSinceWhenItsSceneIsUsed) {
  LastTickBoard board;
  EXPECT_FALSE(board.newest());
  for (std::uint64_t tick = 0; tick < 10; ++tick) {
    TickSample sample = Sample(tick, ForceState::kOn);
    sample.time_ns = 1000 + static_cast<std::int64_t>(tick);
    sample.scene_revision = tick < 3 ? 1 : tick < 7 ? 2 : 5;
    board.Tell(sample);
    ASSERT_TRUE(board.newest());
    EXPECT_EQ(board.newest()->tick, tick);
    EXPECT_EQ(board.newest()->scene_revision, sample.scene_revision);
    const std::uint64_t since = tick < 3 ? 0 : tick < 7 ? 3 : 7;
    EXPECT_EQ(board.newest()->scene_since_tick, since);
    EXPECT_EQ(board.newest()->scene_since_ns, 1000 + static_cast<std::int64_t>(since));
  }
}

}  // namespace
}  // namespace palpate
