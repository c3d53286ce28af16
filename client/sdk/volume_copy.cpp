#include "client/sdk/volume_copy.h"

#include <algorithm>
#include <utility>

namespace palpate::client {
namespace {

bool IsAll(const Brick& brick, float value) {
  return std::all_of(brick.begin(), brick.end(), [value](float v) { return v == value; });
}

bool IsSame(const std::optional<VolumePlacement>& a, const std::optional<VolumePlacement>& b) {
  if (!a || !b) return a.has_value() == b.has_value();
  return a->settings_revision == b->settings_revision && a->X_DI == b->X_DI;
}

}  // namespace

bool VolumeCopy::Merge(VolumeMirror& mirror) {
  const MirrorChanges changes = mirror.TakeChanges();
  const auto complete = mirror.is_complete() ? mirror.resume() : std::nullopt;
  const std::lock_guard lock(mutex_);
  bool changed = changes.all || !changes.numbers.empty() || update_.complete != complete ||
                 !IsSame(update_.placement, mirror.placement());
  if (changes.all) Begin(mirror);
  for (const std::uint64_t number : changes.numbers) {
    bricks_[number] = mirror.At(number);
    Mark(number);
  }
  if (!has_overview_ && !mirror.overview().empty()) {
    has_overview_ = changed = true;
    update_.overview_size = mirror.overview_size();
    update_.overview.assign(mirror.overview().begin(), mirror.overview().end());
  }
  update_.placement = mirror.placement();
  update_.complete = complete;
  update_.bricks_left = mirror.bricks_left();
  is_new_ = is_new_ || changed;
  return changed;
}

std::optional<VolumeUpdate> VolumeCopy::Take() {
  const std::lock_guard lock(mutex_);
  if (!std::exchange(is_new_, false)) return std::nullopt;
  VolumeUpdate taken = update_;
  std::sort(marked_.begin(), marked_.end());
  taken.bricks.reserve(marked_.size());
  for (const std::uint64_t number : marked_) {
    taken.bricks.push_back({number, bricks_[number]});
    is_marked_[number] = false;
  }
  marked_.clear();
  update_.all = false;
  update_.overview_size = Vec3i::Zero();
  update_.overview.clear();
  return taken;
}

void VolumeCopy::Begin(const VolumeMirror& mirror) {
  update_ = {};
  update_.all = true;
  update_.lattice = mirror.lattice();
  bricks_.clear();
  marked_.clear();
  has_overview_ = false;
  const std::uint64_t count = update_.lattice ? update_.lattice->Bricks() : 0;
  is_marked_.assign(count, false);
  bricks_.reserve(count);
  // Bricks of background share one object. Compare that object only once.
  const Brick* background = nullptr;
  for (std::uint64_t number = 0; number < count; ++number) {
    const BrickPtr& brick = bricks_.emplace_back(mirror.At(number));
    if (brick.get() == background) continue;
    if (IsAll(*brick, update_.lattice->Background())) {
      background = brick.get();
    } else {
      Mark(number);
    }
  }
}

void VolumeCopy::Mark(std::uint64_t number) {
  if (is_marked_[number]) return;
  is_marked_[number] = true;
  marked_.push_back(number);
}

}  // namespace palpate::client
