// The servo thread: 1 kHz ticks between an inbox and an outbox.
//
// Threads: construct, Start and Stop on the main thread; grant() after Start; the counters on any
// thread. Real-time: the servo thread does not lock, allocate or log. It waits only for its timer.
// Ownership: borrows device, inbox and outbox, which must outlive this object. Stop joins the
// thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>

#include "server/device/haptic_device.h"
#include "server/felt/scene.h"
#include "server/pump/tick_outbox.h"
#include "server/realtime/thread_setup.h"
#include "server/servo/servo_tick.h"

namespace palpate {

class ServoLoop {
 public:
  static constexpr double kRateHz = 1000.0;

  ServoLoop(HapticDevice& device, SceneInbox& inbox, TickOutbox& outbox,
            const RealtimeOptions& options, const SafetyLimits& limits);
  ~ServoLoop() { Stop(); }

  // Publish a scene first. Returns when the thread runs and knows what the kernel granted. Throws
  // Error if the device does not start.
  void Start();
  // Writes zero force, then stops the device. A second call does nothing.
  void Stop() noexcept;

  // Takes the operator's commands. Any thread.
  ForceSwitch& forces() { return forces_; }
  // Takes tries of the motors. One thread at a time.
  HandPush& pushes() { return pushes_; }

  const RealtimeGrant& grant() const { return grant_; }
  std::uint64_t ticks() const { return ticks_.load(); }
  // A tick that certainly knows a command which was given before: the present one may have read the
  // commands already.
  std::uint64_t FirstTickThatKnows() const { return ticks() + 1; }
  std::uint64_t missed_ticks() const { return missed_ticks_.load(std::memory_order_relaxed); }
  // Ticks with zero force because of the device, a bad position or a bad force.
  std::uint64_t faulty_ticks() const { return faulty_ticks_.load(std::memory_order_relaxed); }
  // Samples that did not fit into the outbox.
  std::uint64_t lost_samples() const { return outbox_.overflows(); }
  // Page faults of the servo thread since its first tick; counted once a second.
  std::int64_t page_faults() const { return page_faults_.load(std::memory_order_relaxed); }

 private:
  void Run() noexcept;

  HapticDevice& device_;
  SceneInbox& inbox_;
  TickOutbox& outbox_;
  RealtimeOptions options_;
  SafetyLimits limits_;
  ForceSwitch forces_;
  HandPush pushes_;
  RealtimeGrant grant_;
  std::atomic<bool> running_{false};  // the thread knows what the kernel granted
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> ticks_{0};
  std::atomic<std::uint64_t> missed_ticks_{0};
  std::atomic<std::uint64_t> faulty_ticks_{0};
  std::atomic<std::int64_t> page_faults_{0};
  std::thread thread_;
};

}  // namespace palpate
