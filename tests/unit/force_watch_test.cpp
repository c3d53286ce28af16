// The newest tick's forces, and waiting for a tick.
#include "server/session/force_watch.h"

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
  const ForceWatch watch;
  EXPECT_FALSE(watch.newest());
  EXPECT_FALSE(watch.WaitForTick(0, milliseconds(1)));
}

TEST(ForceWatch, TellsTheNewestTickAndSinceWhenItIsSo) {
  ForceWatch watch;
  watch.OnSample(Sample(7, ForceState::kOn));
  watch.OnSample(Sample(9, ForceState::kOn));
  ASSERT_TRUE(watch.newest());
  EXPECT_EQ(watch.newest()->tick, 9u);
  EXPECT_EQ(watch.newest()->since_tick, 7u);
  EXPECT_EQ(watch.newest()->limit_n, 9.5);
  watch.OnSample(Sample(10, ForceState::kStopped, ForceReason::kStopButton));
  EXPECT_EQ(watch.newest()->since_tick, 10u);
  // Another reason is another story.
  watch.OnSample(Sample(12, ForceState::kStopped, ForceReason::kStopCall));
  EXPECT_EQ(watch.newest()->since_tick, 12u);
  EXPECT_EQ(watch.newest()->state, ForceState::kStopped);
  EXPECT_EQ(watch.newest()->reason, ForceReason::kStopCall);
}

TEST(ForceWatch, AnOldTickIsNoWait) {
  ForceWatch watch;
  watch.OnSample(Sample(100, ForceState::kOff, ForceReason::kOperator));
  for (const std::uint64_t tick : {0u, 99u, 100u}) {
    ASSERT_TRUE(watch.WaitForTick(tick, milliseconds(0)));
    EXPECT_EQ(watch.WaitForTick(tick, milliseconds(0))->tick, 100u);
  }
  EXPECT_FALSE(watch.WaitForTick(101, milliseconds(0)));
  EXPECT_FALSE(watch.WaitForTick(101, milliseconds(5)));
}

TEST(ForceWatch, ManyWaitEachForItsTick) {
  ForceWatch watch;
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
    watch.OnSample(Sample(tick, tick / 50 % 2 == 0 ? ForceState::kOn : ForceState::kHeld));
    if (tick % 100 == 0) std::this_thread::sleep_for(milliseconds(1));
  }
  for (std::thread& waiter : waiters) waiter.join();
  EXPECT_EQ(wrong, 0);
}

}  // namespace
}  // namespace palpate
