// Recorded samples in place of the live ones, at their pace.
//
// The live ticks are the clock: for each, the recorded sample of that moment is shown
// under the live tick, time, revisions and counters, so that streams go on without a
// jump, thin out as ever, and at any speed.
//
// Positions: ms of the recording, in which its samples lie 1 ms apart or more.
// Threads: any. Real-time: none, but nothing waits longer than for a copy.
#pragma once

#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>

#include "server/samples/pump.h"

namespace palpate {

class ShownSamples final : public SampleReplacement {
 public:
  // speed: ms of the recording per ms, above 0.
  explicit ShownSamples(double speed) : speed_(speed) {}

  TickSample Shown(const TickSample& live) override;

  // In the order of positions. Where none is left, the last one stays.
  void Add(const TickSample& sample, double position_ms);

  double position_ms() const;
  std::size_t waiting() const;
  std::uint64_t passed() const;  // samples shown or skipped

 private:
  struct Placed {
    double position_ms;
    TickSample sample;
  };

  const double speed_;
  mutable std::mutex mutex_;  // guards what follows
  std::deque<Placed> waiting_;
  std::optional<TickSample> current_;
  std::optional<std::uint64_t> live_ms_;  // of the last call
  double position_ms_ = 0.0;
  double end_ms_ = 0.0;  // of what was added
  std::uint64_t passed_ = 0;
};

}  // namespace palpate
