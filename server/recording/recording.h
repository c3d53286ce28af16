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
#include "server/haptics/passivity.h"
#include "server/haptics/settings.h"
#include "server/recording/volume_hash.h"
#include "server/samples/tick_sample.h"
#include "server/volume/brick_directory.h"

namespace palpate {

struct RecordingHeader {
  std::int64_t created_unix_ns = 0;
  std::string program{};  // "palpated 0.1.0"
};

// Samples of consecutive ticks, at most kSamplesPerChunk.
using RecordedSamples = std::vector<TickSample>;
inline constexpr std::size_t kSamplesPerChunk = 1000;

// All but the voxels that the servo computes with, from `tick` on. The voxels are
// those of the volume that was loaded last, with all edits since; volume_hash tells
// whether a replay has them.
struct RecordedScene {
  std::uint64_t tick = 0;  // the first recorded one that used it
  std::uint64_t scene_revision = 0;
  std::uint64_t settings_revision = 0;
  std::uint64_t volume_revision = 0;
  std::uint64_t loaded_revision = 0;    // the volume revision at which it was loaded
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
  Vec3 spacing_mm = Vec3::Ones();
  // Voxels have changed since the scene before, more than a recording takes: replays
  // go on where they meet a volume again that they know.
  bool voxels_missing = false;
  double tick_period_s = 0.0;
  SafetyLimits safety{};
  bool forces_off = false;
  // Recordings of version 2 do not have it: they are felt as with an Omni.
  PassivityDevice device{};
  // Loading volume_source again gives the volume. Where it does not, the recording holds the
  // voxels.
  bool reloadable = true;
  // The edits before this scene hold all voxels: they lead from no volume.
  bool all_voxels_stored = false;
  Vec3i size = Vec3i::Zero();  // voxels
  double value_min = 0.0;      // range of the volume, data units
  double value_max = 0.0;
  bool is_level_set = false;  // no recording before version 4 has one
};

struct RecordedBrick {
  std::uint64_t number = 0;  // BrickDirectory::NumberOf
  LeafPtr values{};
};

// Changed voxels: what makes the volume of the scene that follows from that of the
// last one with edits, or from the one that was loaded, or from nothing
// (base_revision 0). A large change is parted into several of these.
struct RecordedEdit {
  std::uint64_t tick = 0;
  std::uint64_t base_revision = 0;      // volume revision to change
  std::uint64_t volume_revision = 0;    // that all parts together lead to
  std::vector<RecordedBrick> bricks{};  // at most kBricksPerEdit, by number
};
inline constexpr std::size_t kBricksPerEdit = 4096;

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

// State of the servo before `tick`, in the bytes of servo_keyframe.h: where a replay
// may start. There is one within 64 ticks of the start and of every gap, and one about
// every second.
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
