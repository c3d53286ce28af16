// The servo thread's output: its samples and keyframes, and its newest tick.
//
// Threads: the servo thread pushes and tells; the pump thread pops; any ordinary thread reads
// `last`. Real-time: pushing and telling are wait-free. Items that do not fit are counted and lost.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>

#include "server/pump/tick_sample.h"
#include "server/realtime/latest_value.h"
#include "server/realtime/spsc_ring.h"

namespace palpate {

// Holds the newest tick and the first tick of each scene, written by the servo itself. Whether the
// servo runs, what it does with forces and which scenes it uses can thus be read even if the
// samples are late.
//
// Threads: Tell and TellEnd on the servo thread; newest on any ordinary thread; scene_uses has one
// reader at a time. Real-time: Tell is wait-free.
struct LastTick {
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;  // its start, on CLOCK_MONOTONIC
  ForceStatus forces{ForceState::kOff, ForceReason::kOperator};
  std::uint64_t forces_since_tick = 0;  // the first tick with this state and reason
  std::uint64_t stop_tick = 0;          // the newest that obeyed a call to stop; 0: none
  std::uint64_t scene_revision = 0;
  bool ended = false;  // the loop has ended after this tick, and the force is zero
};

// The first tick with a scene.
struct SceneUse {
  std::uint64_t scene_revision = 0;
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;  // its start, on CLOCK_MONOTONIC
};

class LastTickBoard {
 public:
  void Tell(const TickSample& sample) noexcept;
  // The loop has written zero force, and ticks no more.
  void TellEnd() noexcept;
  // None before the first tick.
  std::optional<LastTick> newest() const;
  // As newest, without a lock; the emergency stop's thread only.
  const std::optional<LastTick>& NewestForStop() noexcept { return told_to_stop_.Read(); }

  // Ascending. Skipped scenes are missing.
  SpscRing<SceneUse, 4096> scene_uses;

 private:
  std::optional<LastTick> last_;  // the servo thread's
  mutable std::mutex readers_;    // guards told_, which has one reader at a time
  mutable LatestValue<std::optional<LastTick>> told_;
  LatestValue<std::optional<LastTick>> told_to_stop_;
};

class TickOutbox : public SpscRing<TickSample, 4096> {  // four seconds
 public:
  // One keyframe every kKeyframeTicks, pushed before the sample of its tick.
  SpscRing<ServoKeyframe, 64> keyframes;
  // Updated after each tick; holds the newest tick even if the rings are full.
  LastTickBoard last;
};

struct ForceTick {
  std::uint64_t tick = 0;
  ForceStatus forces{};
  // The first tick with this state and reason.
  std::uint64_t since_tick = 0;
  bool ended = false;  // the loop has ended with zero force; no tick follows
};

// Says what the safety stage did with forces in the newest tick, and waits until a command has been
// taken.
//
// Reads the servo's own board, not the samples. Samples may be late, and an operator who stops
// forces must not be told that the loop stands while it runs.
// Threads: any ordinary thread. Ownership: borrows the board.
class ForceWatch {
 public:
  explicit ForceWatch(const LastTickBoard& board) : board_(board) {}

  // None before the first tick.
  std::optional<ForceTick> newest() const;
  // Waits for a tick with this number or a greater one, and returns the first such tick that it
  // sees; or the last one of a loop that has ended. Returns none at the timeout. Polls each
  // millisecond, because the servo wakes nobody.
  std::optional<ForceTick> WaitForTick(std::uint64_t tick, std::chrono::milliseconds timeout) const;

 private:
  const LastTickBoard& board_;
};

}  // namespace palpate
