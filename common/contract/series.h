// Written by proto/generate from palpate/v1/series.proto: change that.
#pragma once

#include <cstdint>
#include <optional>

#include "common/contract/volume.h"

namespace palpate {

struct SeriesState {
  std::uint32_t frames = 0;
  // In frames; 0 is the first. Between two frames if the series is interpolated.
  double position_frames = 0.0;
  bool playing = false;
  // Frames per second, negative backwards.
  double rate_hz = 0.0;
  bool loop = false;
  bool interpolate = false;
  std::uint64_t memory_bytes = 0;
  // Revision of the frame under the stylus.
  std::uint64_t volume_revision = 0;
  // A recording is replayed: position_frames is the recorded one.
  bool replayed = false;
  friend bool operator==(const SeriesState&, const SeriesState&) = default;
};
template <class Visit>
void VisitFields(const SeriesState& value, Visit&& visit) {
  visit("frames", value.frames);
  visit("position_frames", value.position_frames);
  visit("playing", value.playing);
  visit("rate_hz", value.rate_hz);
  visit("loop", value.loop);
  visit("interpolate", value.interpolate);
  visit("memory_bytes", value.memory_bytes);
  visit("volume_revision", value.volume_revision);
  visit("replayed", value.replayed);
}
template <class Visit>
void VisitFields(SeriesState& value, Visit&& visit) {
  visit("frames", value.frames);
  visit("position_frames", value.position_frames);
  visit("playing", value.playing);
  visit("rate_hz", value.rate_hz);
  visit("loop", value.loop);
  visit("interpolate", value.interpolate);
  visit("memory_bytes", value.memory_bytes);
  visit("volume_revision", value.volume_revision);
  visit("replayed", value.replayed);
}

struct ControlSeriesRequest {
  std::optional<bool> playing{};
  // 0 to frames - 1.
  std::optional<double> position_frames{};
  // Frames per second: -1000 to 1000, not 0. At most 60 volumes are shown per second; frames
  // between them are skipped.
  std::optional<double> rate_hz{};
  // True: begin again at the end; false: stop at the end.
  std::optional<bool> loop{};
  // Blend neighbouring frames linearly in time.
  std::optional<bool> interpolate{};
  friend bool operator==(const ControlSeriesRequest&, const ControlSeriesRequest&) = default;
};
template <class Visit>
void VisitFields(const ControlSeriesRequest& value, Visit&& visit) {
  visit("playing", value.playing);
  visit("position_frames", value.position_frames);
  visit("rate_hz", value.rate_hz);
  visit("loop", value.loop);
  visit("interpolate", value.interpolate);
}
template <class Visit>
void VisitFields(ControlSeriesRequest& value, Visit&& visit) {
  visit("playing", value.playing);
  visit("position_frames", value.position_frames);
  visit("rate_hz", value.rate_hz);
  visit("loop", value.loop);
  visit("interpolate", value.interpolate);
}

struct LoadSeriesResult {
  VolumeDescription volume{};
  SeriesState series{};
  // First tick that used the first frame.
  std::uint64_t applied_tick = 0;
  std::uint64_t settings_revision = 0;
  // That the series starts at, in data units.
  double isovalue = 0.0;
  friend bool operator==(const LoadSeriesResult&, const LoadSeriesResult&) = default;
};
template <class Visit>
void VisitFields(const LoadSeriesResult& value, Visit&& visit) {
  visit("volume", value.volume);
  visit("series", value.series);
  visit("applied_tick", value.applied_tick);
  visit("settings_revision", value.settings_revision);
  visit("isovalue", value.isovalue);
}
template <class Visit>
void VisitFields(LoadSeriesResult& value, Visit&& visit) {
  visit("volume", value.volume);
  visit("series", value.series);
  visit("applied_tick", value.applied_tick);
  visit("settings_revision", value.settings_revision);
  visit("isovalue", value.isovalue);
}

struct ControlSeriesResponse {
  // volume_revision and position_frames are those of the frame that applied_tick names.
  SeriesState series{};
  // First tick that used the frame. If it was under the stylus already: a tick that used it.
  std::uint64_t applied_tick = 0;
  friend bool operator==(const ControlSeriesResponse&, const ControlSeriesResponse&) = default;
};
template <class Visit>
void VisitFields(const ControlSeriesResponse& value, Visit&& visit) {
  visit("series", value.series);
  visit("applied_tick", value.applied_tick);
}
template <class Visit>
void VisitFields(ControlSeriesResponse& value, Visit&& visit) {
  visit("series", value.series);
  visit("applied_tick", value.applied_tick);
}

}  // namespace palpate
