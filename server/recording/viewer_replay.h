// Plays a recording to those who watch a running session.
//
// Forces are off meanwhile; poses are the recorded ones (shown_samples.h); voxels and
// the place of the volume change as they did, and are at the end as they were before.
// Volumes cannot be loaded meanwhile; voxels that others change are lost at the end.
// Where the recording goes on with another volume, or lacks voxels, the last ones stay.
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
  std::uint64_t lost_ticks = 0;  // likewise, within gaps
  std::string marker{};          // that was just passed; empty: none
};
using ViewerReplayProgress = std::function<void(const ViewerReplayState&)>;

inline constexpr double kMaxReplaySpeed = 100.0;

// speed: times real time, above 0 up to kMaxReplaySpeed; gaps take a second at most.
// Throws Error: kInvalidArgument (speed, a recording without a scene), kConflict
// (another volume than the recorded one is there, or is being loaded), kCancelled.
void ReplayToViewers(Session& session, Pump& pump, RecordingReader& reader, double speed,
                     const ViewerReplayProgress& progress, const std::function<bool()>& cancelled);

}  // namespace palpate
