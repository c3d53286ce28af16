// Plays a recording to the viewers of a running session.
//
// During the replay:
// - Forces are off.
// - Poses are the recorded ones (shown_samples.h).
// - Voxels and the place of the volume change as recorded. If the recording continues with another
//   volume, or lacks voxels, the last voxels stay.
// - Volumes cannot be loaded.
// - Voxels cannot be edited.
// At the end, the voxels, the place and the history of edits are as before the replay.
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
// scene), kConflict (the loaded volume is not the recorded one, or a volume is being loaded),
// kCancelled.
void ReplayToViewers(Session& session, Pump& pump, RecordingReader& reader,
                     const ViewerReplayOptions& options, const ViewerReplayProgress& progress,
                     const std::function<bool()>& cancelled);

}  // namespace palpate
