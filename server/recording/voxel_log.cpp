#include "server/recording/voxel_log.h"

#include <algorithm>

namespace palpate {

bool VoxelLog::HasRoomForAll(const VolumeSnapshot& volume) {
  const Vec3i& count = volume.bricks().brick_count();
  return count.cast<std::int64_t>().prod() <= static_cast<std::int64_t>(kMaxBricksPerScene);
}

std::optional<RecordedEdit> VoxelLog::EditBefore(RecordedScene& scene,
                                                 const VolumeSnapshot* volume) {
  if (scene.loaded_revision != loaded_revision_) {
    loaded_revision_ = scene.loaded_revision;
    written_revision_ = scene.reloadable ? loaded_revision_ : 0;
    frames_.clear();
    frame_bricks_ = 0;
  }
  // The volume is too large to store. Its edits are still useful to a user who keeps the uploaded
  // file.
  if (written_revision_ == 0 && volume && !HasRoomForAll(*volume)) {
    written_revision_ = loaded_revision_;
  }
  if (scene.volume_revision == written_revision_) return std::nullopt;
  scene.voxels_missing = true;
  if (!volume) return std::nullopt;
  const std::vector<std::uint64_t> numbers = volume->bricks().ChangedSince(written_revision_);
  if (numbers.size() > kMaxBricksPerScene) return std::nullopt;
  if (numbers.empty()) {  // nothing is written; later edits continue from the revision written last
    scene.voxels_missing = false;
    return std::nullopt;
  }
  RecordedEdit edit = EditOf(scene, *volume, numbers);
  scene.voxels_missing = false;
  scene.all_voxels_stored = written_revision_ == 0;
  written_revision_ = scene.volume_revision;
  return edit;
}

RecordedEdit VoxelLog::EditOf(const RecordedScene& scene, const VolumeSnapshot& volume,
                              const std::vector<std::uint64_t>& numbers) {
  RecordedEdit edit{.tick = scene.tick,
                    .base_revision = written_revision_,
                    .volume_revision = scene.volume_revision};
  if (frames_.contains(scene.volume_hash)) {
    for (const std::uint64_t number : numbers) AddTo(edit.known, {number, 1});
    return edit;
  }
  for (const std::uint64_t number : numbers) {
    edit.bricks.push_back({number, volume.bricks().At(volume.bricks().BrickOf(number))});
  }
  if (scene.ShowsFrame() && frame_bricks_ + numbers.size() <= kMostFrameBricks) {
    frames_.insert(scene.volume_hash);
    frame_bricks_ += numbers.size();
  }
  return edit;
}

}  // namespace palpate
