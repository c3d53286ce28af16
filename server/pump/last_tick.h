// Holds the newest tick and the first tick of each scene, written by the servo itself. Whether the
// servo runs, what it does with forces and which scenes it uses can thus be read even if the
// samples are late.
//
// Threads: Tell and TellEnd on the servo thread; newest on any ordinary thread; scene_uses has one
// reader at a time. Real-time: Tell is wait-free.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>

#include "server/pump/tick_sample.h"
#include "server/realtime/latest_value.h"
#include "server/realtime/spsc_ring.h"

namespace palpate {

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

}  // namespace palpate
