#include "server/recording/voxel_log.h"

#include <algorithm>

namespace palpate {

bool VoxelLog::HasRoomForAll(const VolumeSnapshot& volume) {
  const Vec3i& count = volume.bricks().brick_count();
  return count.cast<std::int64_t>().prod() <= static_cast<std::int64_t>(kMaxBricksPerScene);
}

std::vector<RecordedEdit> VoxelLog::EditsBefore(RecordedScene& scene,
                                                const VolumeSnapshot* volume) {
  if (scene.loaded_revision != loaded_revision_) {
    loaded_revision_ = scene.loaded_revision;
    written_revision_ = scene.reloadable ? loaded_revision_ : 0;
  }
  // The volume is too large to store. Its edits are still useful to a user who keeps the uploaded
  // file.
  if (written_revision_ == 0 && volume && !HasRoomForAll(*volume)) {
    written_revision_ = loaded_revision_;
  }
  if (scene.volume_revision == written_revision_) return {};
  scene.voxels_missing = true;
  if (!volume) return {};
  const std::vector<std::uint64_t> numbers = volume->bricks().ChangedSince(written_revision_);
  if (numbers.size() > kMaxBricksPerScene) return {};
  if (numbers.empty()) {  // nothing is written; later edits continue from the revision written last
    scene.voxels_missing = false;
    return {};
  }
  std::vector<RecordedEdit> edits;
  for (std::size_t first = 0; first < numbers.size(); first += kBricksPerEdit) {
    RecordedEdit& edit = edits.emplace_back();
    edit.tick = scene.tick;
    edit.base_revision = written_revision_;
    edit.volume_revision = scene.volume_revision;
    for (std::size_t n = first; n < std::min(first + kBricksPerEdit, numbers.size()); ++n) {
      edit.bricks.push_back(
          {numbers[n], volume->bricks().At(volume->bricks().BrickOf(numbers[n]))});
    }
  }
  scene.voxels_missing = false;
  scene.all_voxels_stored = written_revision_ == 0;
  written_revision_ = scene.volume_revision;
  return edits;
}

}  // namespace palpate
