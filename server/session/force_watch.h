// What the safety stage did with forces in the newest tick, for those who ask and
// those who wait for their command to have been taken.
//
// Threads: OnSample on the pump's; the rest on any ordinary thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>

#include "server/session/pump.h"

namespace palpate {

struct ForceTick {
  std::uint64_t tick = 0;
  ForceState state = ForceState::kOff;
  ForceReason reason = ForceReason::kOperator;
  double limit_n = 0.0;
  // First tick with this state and reason.
  std::uint64_t since_tick = 0;
};

class ForceWatch : public SampleSink {
 public:
  void OnSample(const TickSample& sample) override;

  // None before the first tick.
  std::optional<ForceTick> newest() const;
  // The first tick seen with this number or a greater one; none when it does not come
  // in time.
  std::optional<ForceTick> WaitForTick(std::uint64_t tick, std::chrono::milliseconds timeout) const;

 private:
  mutable std::mutex mutex_;
  mutable std::condition_variable seen_;
  std::optional<ForceTick> newest_;
};

}  // namespace palpate
