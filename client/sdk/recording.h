// Recordings of the daemon, and their replay. Fields mean what recording.proto says.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace palpate::client {

// What viewers get in place of the live ticks.
struct RunningReplay {
  std::string by;           // such as "token ada at ipv4:192.0.2.7:51544"
  std::string path;         // on the daemon's machine
  std::uint64_t ticks = 0;  // as in ReplayState
  std::uint64_t total_ticks = 0;
  double speed = 1.0;  // multiple of real time

  // A viewer pauses by a very low speed.
  bool is_paused() const { return speed < 1e-6; }
};

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
  std::optional<RunningReplay> replay{};  // none: viewers get the live ticks
};

struct RecordedMarker {
  std::uint64_t tick = 0;  // ticks of the recording before it
  std::string text;
};

struct ReplayOptions {
  double speed = 1.0;  // multiple of real time, above 0, at most 100
  // The first tick to show, counted from the recording's first one.
  std::uint64_t first_tick = 0;
};

struct ReplayState {
  std::uint64_t ticks = 0;  // played so far, and those before the first one that was shown
  std::uint64_t lost_ticks = 0;
  std::string marker;                   // the marker passed since the last call; empty: none
  std::uint64_t total_ticks = 0;        // of the whole recording
  std::vector<RecordedMarker> markers;  // of the whole recording
};

struct RecordedFile {
  std::string path;  // absolute, on the daemon's machine
  std::uint64_t size_bytes = 0;
  std::int64_t modified_s = 0;  // since 1970, UTC
};

struct RecordingList {
  std::string folder;  // where new recordings belong; empty: the daemon saves nowhere
  std::vector<RecordedFile> recordings;  // newest first
};

// Like ProgressFunction: called on the caller's thread; false cancels. May be empty.
using ReplayFunction = std::function<bool(const ReplayState&)>;

}  // namespace palpate::client
