// The contents of a recording of the haptic loop: plain values, in the order of ticks.
//
// A recording is a header and then chunks. Chunks that start at a tick (a scene, a marker, a gap,
// an edit) come before the samples of that tick, so a reader never has to look back. chunk_frame.h
// describes the bytes.
//
// Frames and units: as in TickSample. All numbers read back bit for bit.
// Threads: plain values; not for real-time code (they allocate).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
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

inline constexpr std::size_t kMaxMarkerBytes = 4096;

struct RecordingHeader {
  // The start of the recording, on two clocks at once: UTC since 1970, and CLOCK_MONOTONIC as in
  // TickSample::time_ns. The second is absent before version 6.
  std::int64_t created_unix_ns = 0;
  std::optional<std::int64_t> created_monotonic_ns{};
  std::string program{};  // "palpated 0.1.0"
};

// Samples of consecutive ticks, at most kSamplesPerChunk.
using RecordedSamples = std::vector<TickSample>;
inline constexpr std::size_t kSamplesPerChunk = 1000;

// All data except voxels that the servo computes with, from `tick` on. The voxels are those of the
// last loaded volume with all later edits applied. volume_hash tells a replay if it has these
// voxels.
struct RecordedScene {
  std::uint64_t tick = 0;  // the first recorded tick of this scene
  std::uint64_t scene_revision = 0;
  std::uint64_t settings_revision = 0;
  std::uint64_t volume_revision = 0;
  std::uint64_t loaded_revision = 0;    // the volume revision at which the volume was loaded
  std::uint64_t geometry_revision = 0;  // as in HapticSurface
  double isovalue = 0.0;                // data units
  double normalized_isovalue = 0.0;
  HapticSettings settings{};
  // Names of settings that this program does not know. A newer program wrote them, and forces may
  // depend on them.
  std::vector<std::string> unknown_settings{};
  AffineMap X_DI{};
  VolumeHash volume_hash{};
  std::string volume_source{};
  Vec3 spacing_mm = Vec3::Ones();
  // More voxels have changed since the last scene than a recording stores. A replay continues at
  // the next scene whose volume it knows.
  bool voxels_missing = false;
  double tick_period_s = 0.0;
  SafetyLimits safety{};
  bool forces_off = false;
  // Recordings of version 2 lack it; they are computed as with an Omni.
  PassivityDevice device{};
  // True if loading volume_source again gives the volume. If false, the recording holds the voxels,
  // unless the volume is too large (voxel_log.h).
  bool reloadable = true;
  // True if the edits before this scene hold all voxels: they need no volume to start from.
  bool all_voxels_stored = false;
  Vec3i size = Vec3i::Zero();  // voxels
  double value_min = 0.0;      // value range of the volume, data units
  double value_max = 0.0;
  bool is_level_set = false;  // always false before version 4
  // Places the ticks in the world, for readers; a replay does not need it. Absent before version 5.
  std::optional<AffineMap> X_WI{};
};

struct RecordedBrick {
  std::uint64_t number = 0;  // BrickDirectory::NumberOf
  LeafPtr values{};
};

// Changed voxels. They turn one volume into the volume of the next scene. The first volume is the
// last one with edits, or the loaded one, or nothing (base_revision 0). A large change is split
// into several RecordedEdits.
struct RecordedEdit {
  std::uint64_t tick = 0;
  std::uint64_t base_revision = 0;      // the volume revision that the edit changes
  std::uint64_t volume_revision = 0;    // the volume revision after all parts
  std::vector<RecordedBrick> bricks{};  // at most kBricksPerEdit, sorted by number
};
inline constexpr std::size_t kBricksPerEdit = 4096;
// Of the bricks of one chunk.
inline constexpr std::uint64_t kMostChunkBytes = kBricksPerEdit * sizeof(Brick);

struct TimedMarker {
  // The last recorded tick that began at or before time_ns; if none did, the first recorded tick.
  // Before version 6: some tick nearby. Readers place markers by their time.
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;  // CLOCK_MONOTONIC, when it was set
  std::string text{};        // UTF-8
};

// Ticks that were not recorded.
struct RecordedGap {
  std::uint64_t first_tick = 0;
  std::uint64_t last_tick = 0;
};

// The servo's state before `tick`, in the bytes of servo_keyframe.h. A replay can start there.
// There is a keyframe within 64 ticks of the start and of every gap, and about every second.
struct RecordedKeyframe {
  std::uint64_t tick = 0;
  std::string bytes{};
};

// The last chunk of a recording that was closed.
struct RecordedEnd {
  std::uint64_t ticks = 0;
  std::uint64_t lost_ticks = 0;  // within gaps
};

using RecordedChunk = std::variant<RecordedSamples, RecordedScene, RecordedEdit, TimedMarker,
                                   RecordedGap, RecordedKeyframe, RecordedEnd>;

}  // namespace palpate
