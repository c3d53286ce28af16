// The newest tick, told by the servo itself: whether it runs, what it does with forces and
// which scene it uses must not depend on how soon somebody carries its samples.
//
// Threads: Tell on the servo's; newest on any ordinary one. Real-time: Tell is wait-free.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>

#include "server/realtime/latest_value.h"
#include "server/samples/tick_sample.h"

namespace palpate {

struct LastTick {
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;  // its start, on CLOCK_MONOTONIC
  ForceState force_state = ForceState::kOff;
  ForceReason force_reason = ForceReason::kOperator;
  double force_limit_n = 0.0;
  std::uint64_t forces_since_tick = 0;  // the first with this state and reason
  std::uint64_t scene_revision = 0;
  std::uint64_t scene_since_tick = 0;  // the first with this scene
  std::int64_t scene_since_ns = 0;     // its start, on CLOCK_MONOTONIC
};

class LastTickBoard {
 public:
  void Tell(const TickSample& sample) noexcept;
  // None before the first tick.
  std::optional<LastTick> newest() const;

 private:
  std::optional<LastTick> last_;  // the servo's
  mutable std::mutex readers_;    // for told_, which has one reader at a time
  mutable LatestValue<std::optional<LastTick>> told_;
};

}  // namespace palpate
