// Which voxels a recording still lacks.
//
// Bricks carry the revision at which they changed last. So what a scene's volume has
// that the recording has not is asked of its snapshot when the scene is written:
// edits between two scenes come together by themselves, those that no tick used among
// them, and those made since the volume was loaded and before the recording began.
// Nothing is kept but the revision that was written last.
//
// Of a volume that cannot be loaded again (an upload, a series) all voxels are written
// once, as a change from nothing, where there is room for them.
//
// Threads: one. Not for real-time code.
#pragma once

#include <cstdint>
#include <vector>

#include "server/recording/recording.h"
#include "server/volume/snapshot.h"

namespace palpate {

class VoxelLog {
 public:
  // A larger change is left out: 64 MiB of voxels would take the disk's time for
  // seconds of ticks.
  static constexpr std::size_t kMaxBricksPerScene = (std::size_t{64} << 20) / sizeof(Brick);

  // All voxels of the volume are within that.
  static bool HasRoomForAll(const VolumeSnapshot& volume);

  // For the next scene to be written. What to write before it: the changes up to
  // `volume`, which is the scene's, or null where it is not known any more. Sets
  // scene.voxels_missing where they are left out; they are then part of the next
  // ones. Sets scene.all_voxels_stored where they are all of the volume's.
  std::vector<RecordedEdit> EditsBefore(RecordedScene& scene, const VolumeSnapshot* volume);

 private:
  std::uint64_t loaded_revision_ = 0;
  std::uint64_t written_revision_ = 0;
};

}  // namespace palpate
