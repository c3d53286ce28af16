// What a replay can be asked for: how long a recording is, and where its markers are.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/contract/recording.h"
#include "server/recording/recording_reader.h"

namespace palpate {

// A marker's tick counts the recorded ticks before it, as palpate.v1.RecordedMarker says. Ticks
// that were not recorded do not count.
struct RecordingOutline {
  std::uint64_t ticks = 0;
  std::vector<RecordedMarker> markers{};  // in order
};

// A small file may hold gigabytes of markers: later ones are left out.
inline constexpr std::size_t kMostOutlineBytes = std::size_t{1} << 20;

// Reads to the end, or to the first damage. Throws Error: kCancelled.
RecordingOutline ReadOutline(RecordingReader& reader, const std::function<bool()>& cancelled);

}  // namespace palpate
