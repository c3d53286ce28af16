#include "server/servo/servo_loop.h"

#include <chrono>

#include "server/realtime/tick_timer.h"
#include "server/servo/servo_tick.h"

namespace palpate {

ServoLoop::ServoLoop(HapticDevice& device, SceneInbox& inbox, TickOutbox& outbox,
                     const RealtimeOptions& options, const SafetyLimits& limits)
    : device_(device), inbox_(inbox), outbox_(outbox), options_(options), limits_(limits) {}

void ServoLoop::Start() {
  device_.Start();
  stop_.store(false);
  inbox_.ReaderRestarts();
  running_.store(false);
  thread_ = std::thread([this] { Run(); });
  running_.wait(false);
}

void ServoLoop::Stop() noexcept {
  if (!thread_.joinable()) return;
  stop_.store(true);
  thread_.join();
  inbox_.ReaderStopped();
  device_.Stop();
}

void ServoLoop::Run() noexcept {
  SetupRealtimeThread(options_, grant_);
  const auto tick = std::make_unique<ServoTick>(device_, limits_, &forces_, &pushes_);
  TickTimer timer(std::chrono::milliseconds(1));
  constexpr std::uint64_t kTicksPerSecond = 1000;
  const std::int64_t faults_at_start = ThreadPageFaults();
  running_.store(true);
  running_.notify_one();
  while (!stop_.load(std::memory_order_relaxed)) {
    const TickTime time = timer.WaitForNext();
    if (tick->next_tick() % kKeyframeTicks == 0) outbox_.keyframes.TryPush(tick->Keyframe());
    const TickSample sample = tick->Run(*inbox_.Acquire(), time);
    outbox_.TryPush(sample);
    outbox_.last.Tell(sample);
    ticks_.store(sample.tick + 1);
    missed_ticks_.store(sample.missed_ticks, std::memory_order_relaxed);
    faulty_ticks_.store(sample.faulty_ticks, std::memory_order_relaxed);
    if (sample.tick % kTicksPerSecond == 0) {
      page_faults_.store(ThreadPageFaults() - faults_at_start, std::memory_order_relaxed);
    }
  }
  device_.Write({}, kTickPeriodS);
  outbox_.last.TellEnd();
}

}  // namespace palpate
