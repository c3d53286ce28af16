// Plays a recording to the viewers of a running session.
//
// During the replay:
// - Forces are off.
// - Viewers get the recorded poses (shown_samples.h) and the recorded scenes (session/shown.h):
//   settings, tip, place, voxels and position of a series. A pose has the settings' revision of its
//   scene. If the recording lacks voxels, the last ones stay. If it goes on with another volume,
//   the replay ends.
// - Nothing of the session changes. Other volumes cannot be loaded.
// If viewers cannot get the session back at the end, the last scene stays, and forces stay off.
//
// Threads: any ordinary one; blocks until the end.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "server/recording/recording_reader.h"
#include "server/session/session.h"

namespace palpate {

struct ViewerReplayOptions {
  double speed = 1.0;  // multiple of real time, above 0, at most kMaxReplaySpeed
  // Starts at this place (recording_outline.h). What changed before it is applied at once.
  std::uint64_t first_tick = 0;
  // Who replays, in words; told to viewers.
  std::string by{};
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
