// Recordings of the daemon, and their replay. recording.proto explains the fields.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <functional>

#include "common/contract/recording.h"

namespace palpate::client {

using palpate::RecordedFile;
using palpate::RecordedMarker;
using palpate::RecordingState;
using palpate::RunningReplay;

using RecordingList = ListRecordingsResponse;
using ReplayState = ReplayResponse;

// A viewer pauses by a very low speed.
inline bool IsPaused(const RunningReplay& replay) { return replay.speed < 1e-6; }

struct ReplayOptions {
  double speed = 1.0;  // multiple of real time, above 0, at most 100
  // The first tick to show, counted from the recording's first one.
  std::uint64_t first_tick = 0;
};

// Like ProgressFunction: called on the caller's thread; false cancels. May be empty.
using ReplayFunction = std::function<bool(const ReplayState&)>;

}  // namespace palpate::client
