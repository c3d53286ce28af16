// Finds the voxels that a recording still lacks.
//
// Each brick carries the revision of its last change. When a scene is written, the log asks the
// scene's snapshot for the bricks that have changed since the revision written last. The answer
// also covers edits that no tick used, and edits made between the load of the volume and the
// start of the recording. The log keeps only the revision written last.
//
// A volume that cannot be loaded again (an upload, a series) is written whole, once, as a change
// from nothing. A volume above kMaxBricksPerScene is not written whole. A series' frame that comes
// again is known by its hash: only the numbers of the changed bricks are written.
//
// Threads: one. Not for real-time code.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "server/recording/recording.h"
#include "server/recording/volume_hash.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

class VoxelLog {
 public:
  // Changes above 64 MiB are recorded only as missing: the disk would need the time of seconds of
  // ticks to write them.
  static constexpr std::size_t kMaxBricksPerScene = (std::size_t{64} << 20) / sizeof(Brick);

  // True if the whole volume fits into kMaxBricksPerScene.
  static bool HasRoomForAll(const VolumeSnapshot& volume);

  // Returns the edit to write before `scene`, the next scene of the recording. `volume`: the
  // scene's volume, or null if it is no longer known. If the changes are left out, sets
  // scene.voxels_missing; the next call then includes them. If the edit holds all voxels of the
  // volume, sets scene.all_voxels_stored.
  std::optional<RecordedEdit> EditBefore(RecordedScene& scene, const VolumeSnapshot* volume);

 private:
  RecordedEdit EditOf(const RecordedScene& scene, const VolumeSnapshot& volume,
                      const std::vector<std::uint64_t>& numbers);

  std::uint64_t loaded_revision_ = 0;
  std::uint64_t written_revision_ = 0;
  std::set<VolumeHash> frames_;  // that came
  std::uint64_t frame_bricks_ = 0;
};

}  // namespace palpate
