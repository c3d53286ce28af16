#include "server/recording/voxel_log.h"

#include <algorithm>

namespace palpate {

std::vector<RecordedEdit> VoxelLog::EditsBefore(RecordedScene& scene,
                                                const VolumeSnapshot* volume) {
  if (scene.loaded_revision != loaded_revision_) {
    loaded_revision_ = written_revision_ = scene.loaded_revision;
  }
  if (scene.volume_revision == written_revision_) return {};
  scene.voxels_missing = true;
  if (!volume) return {};
  const std::vector<std::uint64_t> numbers = volume->bricks().ChangedSince(written_revision_);
  if (numbers.size() > kMaxBricksPerScene) return {};
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
  written_revision_ = scene.volume_revision;
  return edits;
}

}  // namespace palpate
