#include "client/sdk/volume_copy.h"

#include <algorithm>
#include <utility>

namespace palpate::client {
namespace {

// Changes that nobody takes must not pile up.
constexpr std::size_t kMostRuns = 4096;

}  // namespace

bool VolumeCopy::Merge(VolumeMirror& mirror) {
  const MirrorChanges changes = mirror.TakeChanges();
  const auto complete = mirror.is_complete() ? mirror.resume() : std::nullopt;
  const std::lock_guard lock(mutex_);
  bool changed = changes.all || !changes.bricks.empty() || update_.complete != complete ||
                 update_.placement != mirror.placement();
  if (changes.all) Begin(mirror);
  for (const BrickRun& run : changes.bricks) {
    bricks_.CopyFrom(mirror.bricks(), run);
    AddTo(update_.changed, run);
  }
  if (update_.changed.size() > 2 * joined_ + kMostRuns) {
    Join(update_.changed);
    joined_ = update_.changed.size();
  }
  if (!has_overview_ && !mirror.overview().empty()) {
    has_overview_ = changed = true;
    update_.overview_size = mirror.overview_size();
    update_.overview.assign(mirror.overview().begin(), mirror.overview().end());
  }
  update_.placement = mirror.placement();
  update_.complete = complete;
  update_.content_hash = mirror.content_hash();
  update_.bricks_left = mirror.bricks_left();
  is_new_ = is_new_ || changed;
  return changed;
}

std::optional<VolumeUpdate> VolumeCopy::Take() {
  const std::lock_guard lock(mutex_);
  if (!std::exchange(is_new_, false)) return std::nullopt;
  VolumeUpdate taken = update_;
  Join(taken.changed);
  if (taken.lattice) taken.bricks = bricks_.Share();
  update_.changed.clear();
  joined_ = 0;
  update_.all = false;
  update_.overview_size = Vec3i::Zero();
  update_.overview.clear();
  return taken;
}

void VolumeCopy::Begin(const VolumeMirror& mirror) {
  update_ = {};
  update_.all = true;
  update_.lattice = mirror.lattice();
  joined_ = 0;
  has_overview_ = false;
  bricks_ = mirror.lattice() ? BrickMap(mirror.lattice()->BrickCounts(), mirror.background())
                             : BrickMap();
}

}  // namespace palpate::client
