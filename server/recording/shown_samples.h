// Shows recorded samples in place of live ones, at the recorded pace.
//
// The live ticks are the clock. For each live tick, the recorded sample of that moment is shown
// with the live tick's number, time, counters and state of the forces, and is marked as replayed.
// So streams continue without a jump, and can be thinned out as usual, at any speed.
//
// Positions: ms of the recording. Its samples are 1 ms apart or more.
// Threads: any. Real-time: none, but a call waits at most as long as a copy takes.
#pragma once

#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>

#include "server/pump/pump.h"

namespace palpate {

class ShownSamples final : public SampleReplacement {
 public:
  // speed: ms of the recording per ms of real time, above 0.
  explicit ShownSamples(double speed) : speed_(speed) {}

  TickSample Shown(const TickSample& live) override;

  // Viewers are shown the scene of this number from now on, with this revision of the volume.
  // Samples of later scenes wait for theirs. The settings' revision is the number and
  // `first_revision`.
  void SetScene(std::uint64_t number, std::uint64_t first_revision, std::uint64_t volume_revision);

  // Add samples in the order of positions. settings_revision: the number of the sample's scene.
  // When no sample is left, the last one stays shown.
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
  mutable std::mutex mutex_;  // guards the members below
  std::deque<Placed> waiting_;
  std::uint64_t scene_ = 0, first_revision_ = 0, volume_revision_ = 0;
  std::optional<TickSample> current_;
  std::optional<std::uint64_t> live_ms_;  // of the last live tick
  double position_ms_ = 0.0;
  double end_ms_ = 0.0;  // position of the last sample added
  std::uint64_t passed_ = 0;
};

}  // namespace palpate
