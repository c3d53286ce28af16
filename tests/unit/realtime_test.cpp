// The virtual machines that run this stop for milliseconds now and then: nothing
// here asserts how late a tick may be.
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <memory>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/realtime/latest_value.h"
#include "server/realtime/snapshot_handoff.h"
#include "server/realtime/spsc_ring.h"
#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate {

namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

TEST(SpscRing, GivesBackInOrderAndCountsWhatDidNotFit) {
  SpscRing<int, 4> ring;
  int item = -1;
  EXPECT_FALSE(ring.TryPop(item));
  EXPECT_EQ(item, -1);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(ring.TryPush(i));
  EXPECT_FALSE(ring.TryPush(4));
  EXPECT_FALSE(ring.TryPush(5));
  EXPECT_EQ(ring.overflows(), 2u);
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(ring.TryPop(item));
    EXPECT_EQ(item, i);
  }
  EXPECT_FALSE(ring.TryPop(item));
  EXPECT_TRUE(ring.TryPush(6));
  ASSERT_TRUE(ring.TryPop(item));
  EXPECT_EQ(item, 6);
}

TEST(SpscRing, BetweenThreadsNothingIsLostTornOrReordered) {
  struct Sample {
    std::uint64_t number;
    std::uint64_t copies[6];
  };
  constexpr std::uint64_t kSamples = 200'000;
  SpscRing<Sample, 64> ring;
  std::atomic<bool> done{false};
  std::thread producer([&] {
    for (std::uint64_t i = 1; i <= kSamples; ++i) {
      ring.TryPush({i, {i, i, i, i, i, i}});
      if (i % 64 == 0) std::this_thread::yield();
    }
    done = true;
  });
  std::uint64_t last = 0;
  std::uint64_t popped = 0;
  std::uint64_t wrong = 0;
  Sample sample{};
  for (bool last_round = false;;) {
    while (ring.TryPop(sample)) {
      ++popped;
      if (sample.number <= last) ++wrong;
      for (const std::uint64_t copy : sample.copies) wrong += copy != sample.number;
      last = sample.number;
    }
    if (last_round) break;
    last_round = done;  // then whatever was pushed before is popped in one more round
    std::this_thread::yield();
  }
  producer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(popped + ring.overflows(), kSamples);
  EXPECT_GT(popped, 0u);
}

// A value that knows whether it is whole, and how many of its kind live.
class Snapshot {
 public:
  explicit Snapshot(std::uint64_t seed) : numbers_(256) {
    std::iota(numbers_.begin(), numbers_.end(), seed);
    sum_ = Sum();
    ++live;
  }
  ~Snapshot() {
    numbers_.assign(numbers_.size(), 0);
    --live;
  }
  Snapshot(const Snapshot&) = delete;
  Snapshot& operator=(const Snapshot&) = delete;

  std::uint64_t seed() const { return numbers_.front(); }
  bool whole() const { return Sum() == sum_; }

  static inline std::atomic<int> live{0};

 private:
  std::uint64_t Sum() const { return std::accumulate(numbers_.begin(), numbers_.end(), 1ull); }

  std::vector<std::uint64_t> numbers_;
  std::uint64_t sum_ = 0;
};

TEST(SnapshotHandoff, KeepsWhatTheReaderMayUseAndFreesTheRest) {
  {
    SnapshotHandoff<Snapshot> handoff;
    EXPECT_EQ(handoff.Acquire(), nullptr);
    EXPECT_EQ(handoff.announced(), 0u);

    EXPECT_EQ(handoff.Publish(std::make_unique<const Snapshot>(10)), 1u);
    EXPECT_EQ(handoff.Publish(std::make_unique<const Snapshot>(20)), 2u);
    EXPECT_EQ(Snapshot::live, 2);  // a reader may be about to use either

    const Snapshot* read = handoff.Acquire();
    ASSERT_NE(read, nullptr);
    EXPECT_EQ(read->seed(), 20u);
    EXPECT_EQ(handoff.announced(), 2u);
    EXPECT_EQ(Snapshot::live, 2);  // the reader frees nothing
    handoff.Collect();
    EXPECT_EQ(Snapshot::live, 1);

    handoff.Publish(std::make_unique<const Snapshot>(30));
    handoff.Publish(std::make_unique<const Snapshot>(40));
    EXPECT_EQ(Snapshot::live, 3);  // 20 is in use, 30 might be
    EXPECT_TRUE(read->whole());
    EXPECT_EQ(handoff.Acquire()->seed(), 40u);
    handoff.Collect();
    EXPECT_EQ(Snapshot::live, 1);
  }
  EXPECT_EQ(Snapshot::live, 0);
}

TEST(SnapshotHandoff, AFollowerGetsWhatTheReaderHasLeft) {
  SnapshotHandoff<Snapshot> handoff;
  const auto follow = [&](std::uint64_t seed) {
    return handoff.Follow([&](const Snapshot& value) { return value.seed() == seed; });
  };
  handoff.StartFollowing();
  for (const std::uint64_t seed : {10, 20, 30, 40}) {
    handoff.Publish(std::make_unique<const Snapshot>(seed));
    handoff.Acquire();
  }
  EXPECT_EQ(Snapshot::live, 4);
  std::shared_ptr<const Snapshot> followed = follow(20);
  ASSERT_NE(followed, nullptr);
  handoff.Collect();
  EXPECT_EQ(Snapshot::live, 3);
  EXPECT_EQ(follow(10), nullptr);
  followed = follow(40);
  handoff.Collect();
  EXPECT_EQ(Snapshot::live, 1);

  // A reader that stopped leaves what is still to be followed.
  handoff.Publish(std::make_unique<const Snapshot>(50));
  handoff.Acquire();
  handoff.Publish(std::make_unique<const Snapshot>(60));
  handoff.ReaderStopped();
  EXPECT_EQ(Snapshot::live, 3);
  handoff.FollowedUpTo(handoff.reached());
  handoff.Collect();
  EXPECT_EQ(Snapshot::live, 2);
  EXPECT_TRUE(followed->whole());
  handoff.ReaderRestarts();
  handoff.StopFollowing();
  followed.reset();
  handoff.Acquire();
  handoff.Publish(std::make_unique<const Snapshot>(70));
  handoff.Acquire();
  handoff.Collect();
  EXPECT_EQ(Snapshot::live, 1);
}

TEST(SnapshotHandoff, AStoppedReaderIsQuiescent) {
  SnapshotHandoff<Snapshot> handoff;
  handoff.Publish(std::make_unique<const Snapshot>(1));
  handoff.Acquire();
  handoff.Publish(std::make_unique<const Snapshot>(2));
  handoff.Publish(std::make_unique<const Snapshot>(3));
  EXPECT_EQ(Snapshot::live, 3);
  handoff.ReaderStopped();
  EXPECT_EQ(Snapshot::live, 1);
  handoff.Publish(std::make_unique<const Snapshot>(4));
  EXPECT_EQ(Snapshot::live, 1);
  EXPECT_EQ(handoff.announced(), 1u);

  handoff.ReaderRestarts();
  const Snapshot* read = handoff.Acquire();
  EXPECT_EQ(read->seed(), 4u);
  handoff.Publish(std::make_unique<const Snapshot>(5));
  handoff.Publish(std::make_unique<const Snapshot>(6));
  EXPECT_EQ(Snapshot::live, 3);
  EXPECT_TRUE(read->whole());
}

TEST(SnapshotHandoff, UnderThousandsOfPublishesTheReaderSeesWholeValuesOnly) {
  constexpr int kPublishers = 2;
  constexpr std::uint64_t kPublishesEach = 4000;
  {
    SnapshotHandoff<Snapshot> handoff;
    std::atomic<bool> stop{false};
    std::uint64_t reads = 0;
    std::uint64_t broken = 0;
    std::uint64_t backwards = 0;
    std::thread reader([&] {
      std::uint64_t last = 0;
      while (!stop) {
        const Snapshot* read = handoff.Acquire();
        if (read == nullptr) continue;
        const std::uint64_t announced = handoff.announced();
        backwards += announced < last;
        last = announced;
        broken += !read->whole();
        ++reads;
      }
    });
    std::vector<std::thread> publishers;
    for (int p = 0; p < kPublishers; ++p) {
      publishers.emplace_back([&handoff, p] {
        for (std::uint64_t i = 0; i < kPublishesEach; ++i) {
          handoff.Publish(std::make_unique<const Snapshot>(i * kPublishers + p));
          if (i % 8 == 0) std::this_thread::sleep_for(microseconds(100));
        }
      });
    }
    for (std::thread& publisher : publishers) publisher.join();
    // The reader arrives at the newest, and then the newest is all there is.
    while (handoff.announced() != kPublishers * kPublishesEach) std::this_thread::yield();
    handoff.Collect();
    EXPECT_EQ(Snapshot::live, 1);
    stop = true;
    reader.join();
    EXPECT_EQ(broken, 0u);
    EXPECT_EQ(backwards, 0u);
    EXPECT_GT(reads, 0u);
  }
  EXPECT_EQ(Snapshot::live, 0);
}

TEST(TickTimer, RefusesWhatIsNoPeriod) {
  EXPECT_THROW(TickTimer(nanoseconds(0)), Error);
  EXPECT_THROW(TickTimer(milliseconds(1), nanoseconds(-1)), Error);
}

// Runs the timer for a number of ticks with stalls, and checks what it says of
// each tick against the grid.
void ExpectTicksOnTheGrid(nanoseconds period, nanoseconds spin, int ticks, int stall_every,
                          microseconds stall) {
  TickTimer timer(period, spin);
  const std::int64_t period_ns = period.count();
  const std::int64_t before_ns = MonotonicNowNs();
  std::int64_t start_of_grid_ns = 0;
  TickTime last;
  for (int executed = 1; executed <= ticks; ++executed) {
    const TickTime tick = timer.WaitForNext();
    const auto passed = executed + static_cast<std::int64_t>(tick.missed);
    if (executed == 1) start_of_grid_ns = tick.scheduled_ns - passed * period_ns;
    EXPECT_EQ(tick.scheduled_ns, start_of_grid_ns + passed * period_ns);
    EXPECT_LE(tick.scheduled_ns, tick.started_ns);
    EXPECT_LT(tick.started_ns, tick.scheduled_ns + period_ns);
    EXPECT_GE(tick.missed, last.missed);
    last = tick;
    if (stall_every > 0 && executed % stall_every == 0) std::this_thread::sleep_for(stall);
  }
  EXPECT_GE(start_of_grid_ns, before_ns);
  const std::int64_t elapsed = (last.started_ns - start_of_grid_ns) / period_ns;
  EXPECT_EQ(ticks + static_cast<std::int64_t>(last.missed), elapsed);
}

TEST(TickTimer, TicksAndMissedDeadlinesAreAllThePeriodsThatPassed) {
  ExpectTicksOnTheGrid(milliseconds(1), TickTimer::kDefaultSpin, 200, 0, {});
  ExpectTicksOnTheGrid(milliseconds(1), nanoseconds(0), 50, 0, {});
  // A spin longer than the period: no sleep at all.
  ExpectTicksOnTheGrid(microseconds(300), milliseconds(1), 50, 0, {});
}

TEST(TickTimer, KeepsItsPhaseThroughStalls) {
  ExpectTicksOnTheGrid(milliseconds(1), TickTimer::kDefaultSpin, 60, 10, microseconds(7500));
}

TEST(TickTimer, AStallOfSevenAndAHalfPeriodsIsCounted) {
  TickTimer timer(milliseconds(1));
  const TickTime before = timer.WaitForNext();
  std::this_thread::sleep_for(microseconds(7500));
  const TickTime after = timer.WaitForNext();
  // The stall began after a deadline: seven more have passed at its end, and the
  // tick is for the last of them.
  EXPECT_GE(after.missed - before.missed, 6u);
  EXPECT_GE(after.scheduled_ns - before.scheduled_ns, 7'000'000);
}

// Lowers a soft limit of the process while it lives.
class SoftLimit {
 public:
  SoftLimit(__rlimit_resource resource, rlim_t most) : resource_(resource) {
    getrlimit(resource, &before_);
    rlimit lowered = before_;
    lowered.rlim_cur = std::min(before_.rlim_cur, most);
    setrlimit(resource, &lowered);
  }
  ~SoftLimit() { setrlimit(resource_, &before_); }
  SoftLimit(const SoftLimit&) = delete;
  SoftLimit& operator=(const SoftLimit&) = delete;

 private:
  __rlimit_resource resource_;
  rlimit before_{};
};

// Runs `work` on a thread without capabilities and with finite limits, so that the
// kernel refuses the same whoever runs the tests. Capabilities are per thread.
template <class Work>
void RunWithoutPrivileges(Work work) {
  std::thread([&work] {
    __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
    __user_cap_data_struct none[2]{};
    ASSERT_EQ(syscall(SYS_capset, &header, none), 0);
    const SoftLimit rtprio(RLIMIT_RTPRIO, 0);
    const SoftLimit memlock(RLIMIT_MEMLOCK, 64 * 1024);
    work();
  }).join();
}

void ExpectOneLineEach(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) {
    EXPECT_EQ(warning.find('\n'), std::string::npos) << warning;
    // What the thread does without it.
    const auto says = [&](const char* words) { return warning.find(words) != std::string::npos; };
    EXPECT_TRUE(says("using ordinary scheduling") || says("the thread runs on any CPU") ||
                says("until then ticks will be late") || says("the thread keeps the name"))
        << warning;
  }
}

TEST(ThreadSetup, SaysWhatItCouldNotGetAndGoesOn) {
  RealtimeGrant grant;
  RunWithoutPrivileges([&] { SetupRealtimeThread({.priority = 10, .cpu = 100'000}, grant); });
  EXPECT_FALSE(grant.fifo);
  EXPECT_FALSE(grant.memory_locked);
  ASSERT_EQ(grant.warnings.size(), 3u);
  ExpectOneLineEach(grant.warnings);
  EXPECT_NE(grant.warnings[0].find("CPU 100000"), std::string::npos);
  EXPECT_NE(grant.warnings[1].find("KiB may be locked"), std::string::npos);
  EXPECT_NE(grant.warnings[2].find("SCHED_FIFO 10 refused: Operation not permitted"),
            std::string::npos);
}

// Whatever this machine grants, the answer agrees with the kernel's. Memory is not
// locked here: the sanitizers reserve terabytes.
TEST(ThreadSetup, SaysWhatItGot) {
  RealtimeGrant grant;
  int policy = -1;
  std::string name(16, '\0');
  std::thread([&] {
    SetupRealtimeThread({.priority = 10, .cpu = -1, .lock_memory = false}, grant);
    policy = sched_getscheduler(0);
    pthread_getname_np(pthread_self(), name.data(), name.size());
  }).join();
  EXPECT_EQ(policy, grant.fifo ? SCHED_FIFO | SCHED_RESET_ON_FORK : SCHED_OTHER);
  EXPECT_FALSE(grant.memory_locked);
  EXPECT_EQ(grant.warnings.size(), grant.fifo ? 0u : 1u);
  ExpectOneLineEach(grant.warnings);
  EXPECT_STREQ(name.c_str(), "palpate-rt");
}

TEST(ThreadSetup, RefusesAnImpossiblePriority) {
  RealtimeGrant grant;
  std::thread([&] {
    SetupRealtimeThread({.priority = 1000, .cpu = -1, .lock_memory = false}, grant);
  }).join();
  EXPECT_FALSE(grant.fifo);
  ASSERT_EQ(grant.warnings.size(), 1u);
  EXPECT_NE(grant.warnings.front().find("priority from 1 to 99"), std::string::npos);
}

TEST(ThreadSetup, CountsPageFaults) {
  const long before = ThreadPageFaults();
  constexpr std::size_t kBytes = 64 * 1024 * 1024;
  const std::unique_ptr<char[]> fresh(new char[kBytes]);
  volatile char* touched = fresh.get();
  for (std::size_t i = 0; i < kBytes; i += 4096) touched[i] = 1;
  EXPECT_GT(ThreadPageFaults(), before);
}

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
