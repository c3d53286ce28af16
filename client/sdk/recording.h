// Recordings of the daemon, and their replay. Fields mean what recording.proto says.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace palpate::client {

struct RecordingState {
  bool running = false;
  std::string path;  // on the daemon's machine
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;  // lost because the disk was too slow
  std::uint64_t size_bytes = 0;
  std::string error;  // why the recording ended early; empty: it did not
  bool disk_full = false;
  // Why some ticks cannot be computed again; empty: all can.
  std::string left_out;
};

struct ReplayState {
  std::uint64_t ticks = 0;  // played so far
  std::uint64_t lost_ticks = 0;
  std::string marker;  // the marker passed since the last call; empty: none
};

// Like ProgressFunction: called on the caller's thread; false cancels. May be empty.
using ReplayFunction = std::function<bool(const ReplayState&)>;

}  // namespace palpate::client
