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

struct ViewerReplayState {
  std::uint64_t ticks = 0;       // played so far
  std::uint64_t lost_ticks = 0;  // ticks in the gaps played so far
  std::string marker{};          // the marker just passed; empty: none
};
using ViewerReplayProgress = std::function<void(const ViewerReplayState&)>;

inline constexpr double kMaxReplaySpeed = 100.0;

// speed: multiple of real time, above 0, at most kMaxReplaySpeed. A gap takes at most one second of
// the recording's time.
// Throws Error: kInvalidArgument (speed, a recording without a scene), kConflict (the loaded volume
// is not the recorded one, or a volume is being loaded), kCancelled.
void ReplayToViewers(Session& session, Pump& pump, RecordingReader& reader, double speed,
                     const ViewerReplayProgress& progress, const std::function<bool()>& cancelled);

}  // namespace palpate
