// One tick: reads the device, updates the haptics, writes the force, returns a sample.
//
// Threads: the servo thread only. Real-time: no lock, no allocation, no log, no wait. Only the
// device makes system calls.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bitset>
#include <cstddef>
#include <cstdint>

#include "server/device/haptic_device.h"
#include "server/felt/scene.h"
#include "server/realtime/latest_value.h"
#include "server/realtime/tick_timer.h"
#include "server/safety/safety.h"
#include "server/servo/tick_computation.h"

namespace palpate {

// Holds the operator's newest command for the forces. Any thread sets the command, the servo takes
// it.
//
// Threads: Set and Withdraw on any, Take on the servo thread. Real-time: Take is wait-free.
class ForceSwitch {
 public:
  // The newest command replaces the one that waits. A waiting stop is never replaced. The servo
  // takes a command within a tick.
  void Set(ForceCommand command) noexcept {
    ForceCommand waiting = command_.load();
    do {
      if (waiting == ForceCommand::kStop) return;
    } while (!command_.compare_exchange_weak(waiting, command, std::memory_order_seq_cst));
  }

  // Cancels this command if the servo has not taken it yet.
  void Withdraw(ForceCommand command) noexcept {
    command_.compare_exchange_strong(command, ForceCommand::kNone, std::memory_order_relaxed);
  }

  ForceCommand Take() noexcept {
    // A command is rare, and a load is cheaper than an exchange. In one order with the count of
    // ticks, by which who gives a command knows the tick that has it.
    if (command_.load() == ForceCommand::kNone) return ForceCommand::kNone;
    return command_.exchange(ForceCommand::kNone, std::memory_order_acquire);
  }

 private:
  std::atomic<ForceCommand> command_{ForceCommand::kNone};
};

// A small constant force for a short time, to try the motors of a device. A push waits for nothing:
// if the forces do not act, it is dropped.
//
// Of any 10 s, pushes of all callers together take at most 5 s, each of at most 0.5 N: on average
// 0.25 N at most. The servo's side holds this bound, whatever was asked. Missed ticks count, as the
// device keeps the last force.
//
// Frame D, N. Threads: Push on one ordinary thread at a time; Next on the servo thread; ticks_left
// on any. Real-time: wait-free.
class HandPush {
 public:
  static constexpr double kMostN = 0.5;
  static constexpr int kMostTicks = 5000;  // of any kWindowTicks
  static constexpr std::size_t kWindowTicks = 10'000;

  // The newest push replaces the one before; 0 ticks end it.
  void Push(const Vec3& force_D_n, int ticks) noexcept {
    asked_.Write({++number_, {force_D_n.x(), force_D_n.y(), force_D_n.z()}, ticks});
  }

  // The force of this tick; kNowhere: none. `forces_act`: false ends a push. `missed`: ticks since
  // the last call.
  Vec3 Next(bool forces_act, std::uint64_t missed = 0) noexcept {
    const auto passed = static_cast<int>(std::min<std::uint64_t>(missed, kWindowTicks));
    for (int n = 0; n < passed; ++n) Remember(acts_);
    ticks_left_ = std::max(0, ticks_left_ - passed);
    const Asked& newest = asked_.Read();
    if (newest.number != taken_) {
      taken_ = newest.number;
      force_D_n_ = Vec3(newest.force_n.data());
      ticks_left_ = force_D_n_.stableNorm() <= kMostN ? newest.ticks : 0;  // 0 for NaN
    }
    // The tick that leaves the window counts no more.
    const int used = used_ticks_ - static_cast<int>(pushed_[oldest_]);
    if (!forces_act || used >= kMostTicks) ticks_left_ = 0;
    acts_ = ticks_left_ > 0;
    Remember(acts_);
    if (!acts_) return kNowhere;
    --ticks_left_;
    return force_D_n_;
  }

  // How long pushes may act from now on.
  int ticks_left() const { return std::max(0, kMostTicks - used_ticks_.load()); }

 private:
  struct Asked {
    std::uint64_t number = 0;  // counts from 1
    std::array<double, 3> force_n{};
    int ticks = 0;
  };

  void Remember(bool pushed) noexcept {
    used_ticks_ = used_ticks_ + static_cast<int>(pushed) - static_cast<int>(pushed_[oldest_]);
    pushed_[oldest_] = pushed;
    oldest_ = (oldest_ + 1) % kWindowTicks;
  }

  std::uint64_t number_ = 0;  // of the thread that pushes
  LatestValue<Asked> asked_;
  // The servo thread's; used_ticks_ is told to others.
  std::uint64_t taken_ = 0;
  Vec3 force_D_n_ = Vec3::Zero();
  int ticks_left_ = 0;
  bool acts_ = false;
  std::bitset<kWindowTicks> pushed_;  // of the window, from oldest_ on
  std::size_t oldest_ = 0;
  std::atomic<int> used_ticks_{0};  // of the window
};

class ServoTick {
 public:
  // Borrows all. `forces`: the operator's commands, or null. `pushes`: the tries of the motors, or
  // null.
  ServoTick(HapticDevice& device, const SafetyLimits& limits, ForceSwitch* forces = nullptr,
            HandPush* pushes = nullptr)
      : device_(device),
        forces_(forces),
        pushes_(pushes),
        computation_(limits, PassivityDeviceOf(device.spec())) {}
  explicit ServoTick(HapticDevice& device) : ServoTick(device, LimitsFor(device.spec(), 0)) {}

  // `scene` must stay valid until Run returns.
  TickSample Run(const Scene& scene, const TickTime& time) noexcept;

  // The number of the next tick.
  std::uint64_t next_tick() const { return computation_.next_tick(); }
  ServoKeyframe Keyframe() const noexcept { return computation_.Keyframe(); }

 private:
  HapticDevice& device_;
  ForceSwitch* forces_;
  HandPush* pushes_;
  TickComputation computation_;
  DeviceState stylus_;
  bool forces_act_ = false;  // in the last tick
  bool was_stopped_ = false;
  std::uint64_t missed_ = 0;  // ticks, before the last one
};

}  // namespace palpate
