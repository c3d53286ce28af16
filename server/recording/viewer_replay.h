// Plays a recording to the viewers of a running session.
//
// During the replay:
// - Forces are off.
// - Viewers get the recorded poses and the recorded scenes (session/shown.h):
//   settings, tip, place, voxels and position of a series. A pose has the settings' revision of its
//   scene. If the recording lacks voxels, the last ones stay. If it goes on with another volume,
//   the replay ends.
// - Nothing of the session changes. Other volumes cannot be loaded.
// If viewers cannot get the session back at the end, the last scene stays, and forces stay off.
//
// Threads: any ordinary one; blocks until the end.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "server/pump/pump.h"
#include "server/recording/recording_reader.h"
#include "server/session/session.h"

namespace palpate {

// Shows recorded samples in place of live ones, at the recorded pace.
//
// The live ticks are the clock. For each live tick, the recorded sample of that moment is shown
// with the live tick's number, time, counters and state of the forces, and is marked as replayed.
// So streams continue without a jump, and can be thinned out as usual, at any speed.
//
// Positions: ms of the recording. Its samples are 1 ms apart or more.
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

struct ViewerReplayOptions {
  double speed = 1.0;  // multiple of real time, above 0, at most kMaxReplaySpeed
  // Starts at this place (recording_control.h). What changed before it is applied at once.
  std::uint64_t first_tick = 0;
  // Who replays, in words; told to viewers.
  std::string by{};
  // Returns the voxels as loaded, if they were edited since. A recording that does not begin with
  // the present voxels may begin with these; the present ones are back at its end.
  std::function<std::shared_ptr<const VolumeSnapshot>()> as_loaded{};
};

struct ViewerReplayState {
  std::uint64_t ticks = 0;       // the place: ticks played so far, and those before the first one
  std::uint64_t lost_ticks = 0;  // ticks in the gaps before
  std::string marker{};          // the marker just passed; empty: none
};
using ViewerReplayProgress = std::function<void(const ViewerReplayState&)>;

inline constexpr double kMaxReplaySpeed = 100.0;

// A gap takes at most one second of the recording's time.
// Throws Error: kInvalidArgument (speed, first_tick beyond the last one, a recording without a
// scene), kConflict (the loaded volume is not the recorded one, at first_tick or later, or a volume
// is being loaded), kCancelled; kInternal if the session cannot be shown again.
void ReplayToViewers(Session& session, Pump& pump, RecordingReader& reader,
                     const ViewerReplayOptions& options, const ViewerReplayProgress& progress,
                     const std::function<bool()>& cancelled);

}  // namespace palpate
