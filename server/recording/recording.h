// What a recording of the haptic loop holds: plain values, in the order of ticks.
//
// A recording is a header and then chunks. What starts at a tick (a scene, a
// marker, a gap, an edit) stands before the samples of that tick, so that who
// reads on never has to look back. The bytes are described in chunk_frame.h.
//
// Frames and units: as in TickSample. All numbers come back bit for bit.
// Threads: plain values; not for real-time code (they allocate).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"
#include "server/recording/volume_hash.h"
#include "server/servo/tick_sample.h"

namespace palpate {

struct RecordingHeader {
  std::int64_t created_unix_ns = 0;
  std::string program{};  // "palpated 0.1.0"
};

// Samples of consecutive ticks, at most kSamplesPerChunk.
using RecordedSamples = std::vector<TickSample>;
inline constexpr std::size_t kSamplesPerChunk = 1000;

// All but the voxels that the servo computes with, from `tick` on.
struct RecordedScene {
  std::uint64_t tick = 0;  // the first recorded one that used it
  std::uint64_t scene_revision = 0;
  std::uint64_t settings_revision = 0;
  std::uint64_t volume_revision = 0;
  std::uint64_t geometry_revision = 0;  // of HapticSurface
  double isovalue = 0.0;                // data units
  double normalized_isovalue = 0.0;
  HapticSettings settings{};
  // Names of settings that this program does not know: a newer one wrote them,
  // and forces may depend on them.
  std::vector<std::string> unknown_settings{};
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  AffineMap X_DI{};
  VolumeHash volume_hash{};
  std::string volume_source{};
  double tick_period_s = 0.0;
  double max_force_n = 0.0;  // the limit of the safety stage
  bool forces_off = false;
};

// A change of the volume, in the bytes of those who made it.
struct RecordedEdit {
  std::uint64_t tick = 0;
  std::uint64_t volume_revision = 0;  // that it led to
  std::string bytes{};
};

struct RecordedMarker {
  std::uint64_t tick = 0;    // the first one after it was set
  std::int64_t time_ns = 0;  // CLOCK_MONOTONIC, when it was set
  std::string text{};        // UTF-8
};

// Ticks that were not recorded.
struct RecordedGap {
  std::uint64_t first_tick = 0;
  std::uint64_t last_tick = 0;
};

// State of the renderer before `tick`, in the renderer's own bytes: where a
// replay may start. Nothing writes it yet.
struct RecordedKeyframe {
  std::uint64_t tick = 0;
  std::string bytes{};
};

// The last chunk of a recording that was closed.
struct RecordedEnd {
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;  // within gaps
};

using RecordedChunk = std::variant<RecordedSamples, RecordedScene, RecordedEdit, RecordedMarker,
                                   RecordedGap, RecordedKeyframe, RecordedEnd>;

}  // namespace palpate
