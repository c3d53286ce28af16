#include "server/live_volume/volume_store.h"

#include <fmt/core.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <iterator>
#include <utility>

#include "common/error/error.h"
#include "server/realtime/process_heap.h"
#include "server/volume/snapshot/brick_memory.h"

namespace palpate {
namespace {

// The time between two checks while a volume waits for its last holder, and while a caller waits
// for that.
constexpr std::chrono::milliseconds kPeriod{10};
constexpr std::chrono::milliseconds kUrgentPeriod{2};
// After this number of urgent checks without success, waiting callers stop waiting.
constexpr int kMostVainLooks = 50;

// Less memory goes back by itself.
constexpr std::uint64_t kWorthReturning = std::uint64_t{4} << 20;

}  // namespace

RetiredVolumes::RetiredVolumes(std::function<void()> collect)
    : collect_(std::move(collect)), thread_([this] { Run(); }) {}

RetiredVolumes::~RetiredVolumes() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void RetiredVolumes::Add(std::shared_ptr<const void> retired) {
  if (!retired) return;
  const std::lock_guard lock(mutex_);
  retired_.push_back(std::move(retired));
  if (retired_.size() == 1) wake_.notify_all();
}

void RetiredVolumes::WaitForFreed(std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  ++waiting_;
  vain_looks_ = 0;
  wake_.notify_all();
  looked_.wait_for(lock, patience, [this] {
    return (retired_.empty() && !is_looking_) || vain_looks_ >= kMostVainLooks;
  });
  --waiting_;
}

void RetiredVolumes::Run() {
  pthread_setname_np(pthread_self(), "palpate-free");
  // Freed bricks count until their memory is back: otherwise a new volume would come beside them.
  BrickWork work(BrickWork::Freed::kStillIn);
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stop_ || !retired_.empty(); });
    if (stop_) return;
    Holders taken = std::exchange(retired_, {});
    const std::size_t held = taken.size();
    is_looking_ = true;
    lock.unlock();
    Holders left = Look(std::move(taken));
    if (work.kept_bytes() >= kWorthReturning) ReturnFreedMemory();
    work.LetGo();
    lock.lock();
    is_looking_ = false;
    vain_looks_ = waiting_ > 0 && left.size() == held ? vain_looks_ + 1 : 0;
    retired_.insert(retired_.end(), std::make_move_iterator(left.begin()),
                    std::make_move_iterator(left.end()));
    looked_.notify_all();
    if (retired_.empty()) continue;
    const bool urgent = waiting_ > 0;
    wake_.wait_for(lock, urgent ? kUrgentPeriod : kPeriod,
                   [&] { return stop_ || (waiting_ > 0) != urgent; });
  }
}

RetiredVolumes::Holders RetiredVolumes::Look(Holders retired) {
  collect_();
  // An object that was added twice (as a volume and as the one to revert to) gets one entry.
  std::sort(retired.begin(), retired.end());
  retired.erase(std::unique(retired.begin(), retired.end()), retired.end());
  // With one holder left, only this thread could make a second holder.
  std::erase_if(retired, [](const auto& held) { return held.use_count() == 1; });
  return retired;
}

VolumeStore::VolumeStore(std::shared_ptr<MemoryBudget> budget, std::function<void()> collect,
                         Publish publish)
    : budget_(std::move(budget)), publish_(std::move(publish)), retired_(std::move(collect)) {
  budget_->SetWait([this](std::chrono::milliseconds patience) { retired_.WaitForFreed(patience); });
}

VolumeStore::~VolumeStore() { budget_->SetWait({}); }

EditedRevisions VolumeStore::Edit(const Change& change) {
  const std::lock_guard lock(mutex_);
  if (!present_) throw Error(ErrorKind::kUnavailable, "there is no volume yet");
  const VolumeChange made = change(present_);
  const std::shared_ptr<const VolumeSnapshot> next = Next(made);
  const bool is_changed = next != present_;
  if (made.before_publication) made.before_publication(next->revision());
  EditedRevisions revisions;
  try {
    revisions = is_changed ? Put(next, made.bricks, frames_bytes_, publish_)
                           : EditedRevisions{next->revision(), publish_(next, {})};
  } catch (...) {
    if (made.before_publication) made.before_publication(0);
    throw;
  }
  if (is_changed && made.kind != VolumeChange::Kind::kOther) Count(made.kind);
  if (made.after_publication) made.after_publication();
  return revisions;
}

void VolumeStore::Count(VolumeChange::Kind kind) {
  if (present_->bricks().content_hash() == saved_ && !shows_series()) {
    SetEdits(0);
  } else if (kind == VolumeChange::Kind::kEdit || unsaved_edits_ == 0) {
    SetEdits(unsaved_edits_ + 1);
  }
}

void VolumeStore::SetEdits(std::uint64_t unsaved_edits) {
  unsaved_edits_ = unsaved_edits;
  if (told_) told_(unsaved_edits);
}

void VolumeStore::TellEdits(std::function<void(std::uint64_t)> told) {
  const std::lock_guard lock(mutex_);
  told_ = std::move(told);
  if (told_) told_(unsaved_edits_);
}

void VolumeStore::RequireSaved(bool discards_edits) const {
  const std::uint64_t edits = unsaved_edits_;
  if (edits == 0 || discards_edits) return;
  throw Error(ErrorKind::kFailedPrecondition,
              fmt::format("{} not saved: save the volume (of a series: its frames), or allow to "
                          "discard edits (--discard, discard_edits=True)",
                          edits == 1 ? "an edit is" : fmt::format("{} edits are", edits)));
}

void VolumeStore::Saved(const VolumeSnapshot& volume) {
  const std::lock_guard lock(mutex_);
  if (volume.revision() < replaced_revision_ || shows_series()) return;
  saved_ = volume.bricks().content_hash();
  if (present_->bricks().content_hash() == saved_) SetEdits(0);
}

std::shared_ptr<const VolumeSnapshot> VolumeStore::Next(const VolumeChange& change) const {
  if (change.renumbered) return change.renumbered;
  const std::uint64_t revision = present_->revision() + 1;
  VolumeMetadata metadata = change.whole ? change.whole->metadata : present_->metadata();
  if (change.whole) {
    metadata.series_position_frames.reset();  // no frame has the new lattice
    return std::make_shared<const VolumeSnapshot>(
        std::move(metadata), change.whole->bricks.AllChangedAt(revision), revision, revision);
  }
  const auto position = change.series_position_frames;
  const bool has_moved = position && position != metadata.series_position_frames;
  if (change.bricks.empty() && !has_moved) return present_;
  if (has_moved) metadata.series_position_frames = position;
  return std::make_shared<const VolumeSnapshot>(std::move(metadata),
                                                present_->bricks().With(change.bricks, revision),
                                                revision, present_->loaded_revision());
}

void VolumeStore::Replace(const VolumeMetadata& metadata, const BrickDirectory& bricks,
                          std::uint64_t frames_bytes, bool discards_edits, const Publish& publish) {
  const std::lock_guard lock(mutex_);
  RequireSaved(discards_edits);
  const std::uint64_t revision = present_ ? present_->revision() + 1 : 1;
  Put(std::make_shared<const VolumeSnapshot>(metadata, bricks.AllChangedAt(revision), revision,
                                             revision),
      {}, frames_bytes, publish);
  replaced_revision_ = revision;
  saved_ = present_->bricks().content_hash();
  SetEdits(0);
}

EditedRevisions VolumeStore::Put(std::shared_ptr<const VolumeSnapshot> next,
                                 std::span<const BrickChange> changes, std::uint64_t frames_bytes,
                                 const Publish& publish) {
  const std::uint64_t scene_revision = publish(next, changes);
  retired_.Add(std::exchange(present_, std::move(next)));
  frames_bytes_ = frames_bytes;
  budget_->SetPart("the volume",
                   frames_bytes > 0 ? frames_bytes : present_->bricks().MemoryBytes());
  return {present_->revision(), scene_revision};
}

}  // namespace palpate
