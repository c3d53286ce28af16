// A time series under the stylus. Fields mean what series.proto says.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>

#include "client/sdk/volume.h"

namespace palpate::client {

struct SeriesState {
  std::uint32_t frames = 0;
  double position_frames = 0.0;  // 0 is the first
  bool playing = false;
  double rate_hz = 0.0;  // frames per second, negative backwards
  bool loop = false;
  bool interpolate = false;
  std::uint64_t memory_bytes = 0;
  std::uint64_t volume_revision = 0;
  std::optional<std::uint64_t> applied_tick{};  // of a change: first tick that used the frame
};

// Absent fields change nothing.
struct SeriesControl {
  std::optional<bool> playing{};
  std::optional<double> position_frames{};
  std::optional<double> rate_hz{};
  std::optional<bool> loop{};
  std::optional<bool> interpolate{};
};

struct SeriesResult {
  VolumeInfo volume;  // the first frame
  SeriesState series;
  std::uint64_t settings_revision = 0;
  double isovalue = 0.0;  // that it starts at, data units
};

}  // namespace palpate::client
