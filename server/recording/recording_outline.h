// What a replay can be asked for: how long a recording is, and where its markers are.
//
// Threads: one at a time. Not for real-time code.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "server/recording/recording_reader.h"

namespace palpate {

// A place in a recording is the number of its recorded ticks before it: gaps have no places.
// A marker's place is that of its tick, which its time tells (RecordedMarker).
struct PlacedMarker {
  std::uint64_t place = 0;
  std::string text{};
};

struct RecordingOutline {
  std::uint64_t ticks = 0;
  std::vector<PlacedMarker> markers{};  // in order
};

// A small file may hold gigabytes of markers: later ones are left out.
inline constexpr std::size_t kMostOutlineBytes = std::size_t{1} << 20;

// Reads to the end, or to the first damaged chunk. Throws Error: kCancelled.
RecordingOutline ReadOutline(RecordingReader& reader, const std::function<bool()>& cancelled);

}  // namespace palpate
