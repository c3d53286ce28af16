// The contents of a recording of the haptic loop: plain values, in the order of ticks.
//
// A recording is a header and then items. Items that start at a tick (a scene, a marker, a gap, an
// edit) come before the samples of that tick, so a reader never has to look back.
// palpate/v1/recorded.proto describes the file.
//
// Frames and units: as in TickSample. All numbers read back bit for bit.
// Threads: plain values; not for real-time code (they allocate).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "common/bricks/brick_map.h"
#include "common/contract/recorded.h"
#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/passivity.h"
#include "server/haptics/settings.h"
#include "server/pump/tick_sample.h"
#include "server/recording/mcap.h"
#include "server/recording/volume_hash.h"
#include "server/volume/snapshot/ball.h"
#include "server/volume/snapshot/brick_directory.h"

namespace palpate {

inline constexpr std::size_t kMaxMarkerBytes = 4096;

// What MCAP calls the library, which comes right behind the magic: it tells recordings of Palpate
// from other files. The program follows.
inline constexpr std::string_view kLibraryStart = "Palpate: ";
// Topics and metadata.
inline constexpr const char* kTickTopic = "/tick";
inline constexpr const char* kSceneTopic = "/scene";
inline constexpr const char* kVoxelsTopic = "/voxels";
inline constexpr const char* kKeyframeTopic = "/keyframe";
inline constexpr const char* kEventTopic = "/event";
// Of hands 1, 2 and so on: "/hand1/tick". No program writes them yet.
inline constexpr const char* kFurtherHands = "/hand";
inline constexpr const char* kClockTopic = "/clock";
inline constexpr const char* kHeaderMetadata = "palpate.recording";
inline constexpr const char* kEndMetadata = "palpate.end";

struct RecordingHeader {
  // The start of the recording, on two clocks at once: UTC since 1970, and CLOCK_MONOTONIC as in
  // TickSample::time_ns. The second is absent in recordings that were converted from an older
  // format.
  std::int64_t created_unix_ns = 0;
  std::optional<std::int64_t> created_monotonic_ns{};
  std::string program{};  // "palpated 0.1.0"

  // UTC at a tick's time, ns since 1970. None if it is not known, or of a damaged time.
  std::optional<std::int64_t> UnixOf(std::int64_t time_ns) const {
    std::int64_t since_ns = 0, unix_ns = 0;
    if (!created_monotonic_ns ||
        __builtin_sub_overflow(time_ns, *created_monotonic_ns, &since_ns) ||
        __builtin_add_overflow(created_unix_ns, since_ns, &unix_ns)) {
      return std::nullopt;
    }
    return unix_ns;
  }
};

// Samples of consecutive ticks, at most kSamplesPerChunk. Never empty.
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
  // Settings that this program does not know. A newer program wrote them, and forces may depend on
  // them.
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
  PassivityDevice device{};
  // True if loading volume_source again gives the volume. If false, the recording holds the voxels,
  // unless the volume is too large (voxel_log.h).
  bool reloadable = true;
  // True if the edits before this scene hold all voxels: they need no volume to start from.
  bool all_voxels_stored = false;
  Vec3i size = Vec3i::Zero();  // voxels
  double value_min = 0.0;      // value range of the volume, data units
  double value_max = 0.0;
  bool is_level_set = false;
  // Places the ticks in the world, for readers; a replay does not need it. Absent in recordings
  // that an older program made.
  std::optional<AffineMap> X_WI{};
  std::optional<double> series_position_frames{};  // as SeriesState; none: no series
  HeldTool tool{};                                 // that is felt; without balls: none
  std::vector<Ball> fields{};  // of its radii above 0; without a tool of the ball, if one is felt

  // True for a frame of a series as it was loaded or edited. A blend hardly ever comes again.
  bool ShowsFrame() const {
    return series_position_frames && *series_position_frames == std::floor(*series_position_frames);
  }
};

struct RecordedBrick {
  std::uint64_t number = 0;  // BrickDirectory::NumberOf
  LeafPtr values{};
};

// Changed voxels. They turn one volume into the volume of the next scene. The first volume is the
// last one with edits, or the loaded one, or nothing (base_revision 0). A large change is read as
// several RecordedEdits.
struct RecordedEdit {
  std::uint64_t tick = 0;
  std::uint64_t base_revision = 0;      // the volume revision that the edit changes
  std::uint64_t volume_revision = 0;    // the volume revision after all parts
  std::vector<RecordedBrick> bricks{};  // ascending numbers when written; in any order when read
  // Or, of a series' frame that comes again: bricks that become those of the scene's volume, which
  // the recording held before. Sorted.
  std::vector<BrickRun> known{};

  std::uint64_t BrickCount() const {
    std::uint64_t count = bricks.size();
    // More than any volume has: it must not become a small number.
    for (const BrickRun& run : known) count += std::min(run.count, std::uint64_t{1} << 40);
    return count;
  }
};
// Of the frames of a series that may come again: 1 GiB. Frames beyond are stored each time they
// come.
inline constexpr std::uint64_t kMostFrameBricks = (std::uint64_t{1} << 30) / sizeof(Brick);
// What a reader needs for one item: a chunk, packed and unpacked.
inline constexpr std::uint64_t kMostItemBytes = 2 * mcap::kMostChunkBytes;

// Ticks that were not recorded.
struct RecordedGap {
  std::uint64_t first_tick = 0;
  std::uint64_t last_tick = 0;
};

// There is a keyframe within 64 ticks of the start and of every gap, and about every second.
// RecordedEvent and RecordedKeyframe are those of the contract.
using RecordedItem = std::variant<RecordedSamples, RecordedScene, RecordedEdit, RecordedEvent,
                                  RecordedGap, RecordedKeyframe>;

}  // namespace palpate
