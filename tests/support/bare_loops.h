// A loop without work on each processor, to compare with a loop of palpated of the same period.
// If the machine stops for milliseconds, these loops miss ticks, too.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <thread>
#include <vector>

#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate::test {

class BareLoops {
 public:
  explicit BareLoops(std::chrono::nanoseconds period = std::chrono::milliseconds(1))
      : period_(period) {
    const int processors = static_cast<int>(std::thread::hardware_concurrency());
    for (int cpu = 0; cpu < processors; ++cpu) threads_.emplace_back([this, cpu] { Run(cpu); });
  }
  ~BareLoops() { Stop(); }
  BareLoops(const BareLoops&) = delete;
  BareLoops& operator=(const BareLoops&) = delete;

  // Ends the loops. Returns the ticks missed on all processors together.
  std::uint64_t Stop() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
    return missed_;
  }
  // The missed ticks of the loop that missed most; call it after Stop(). If the whole machine
  // stops, each loop misses the same ticks.
  std::uint64_t most() const { return most_; }

 private:
  void Run(int cpu) {
    RealtimeGrant grant;
    SetupRealtimeThread({.cpu = cpu, .lock_memory = false}, grant);
    // Without a spin: the loops must leave the processors to the servo.
    TickTimer timer(period_, std::chrono::nanoseconds(0));
    std::uint64_t missed = 0;
    while (!stop_) missed = timer.WaitForNext().missed;
    missed_ += missed;
    std::uint64_t most = most_;
    while (most < missed && !most_.compare_exchange_weak(most, missed)) {
    }
  }

  const std::chrono::nanoseconds period_;
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> missed_{0}, most_{0};
  std::vector<std::thread> threads_;
};

}  // namespace palpate::test
