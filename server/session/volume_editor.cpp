#include "server/session/volume_editor.h"

#include <fmt/core.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

// On while it lives.
struct Mark {
  explicit Mark(bool& mark) : on(mark) { on = true; }
  ~Mark() { on = false; }
  bool& on;
};

bool HaveSameLattice(const VolumeMetadata& one, const VolumeMetadata& other) {
  return one.size == other.size && one.spacing_mm == other.spacing_mm &&
         one.origin_W_mm == other.origin_W_mm;
}

// Others wait to edit meanwhile.
constexpr std::chrono::milliseconds kFreeingPatience{200};

// In its turn, and that may be late: for nobody it is not made.
void CheckWanted(const VolumeEditor::Cancelled& cancelled) {
  if (cancelled && cancelled()) throw Error(ErrorKind::kCancelled, "the edit was cancelled");
}

}  // namespace

VolumeEditor::VolumeEditor(Session& session, std::uint64_t max_history_bytes)
    : session_(session), max_history_bytes_(max_history_bytes) {}

EditOutcome VolumeEditor::Edit(const VolumeEdit& edit, const Revision& expected,
                               std::uint64_t stroke, const Cancelled& cancelled) {
  MemoryClaim claim;  // until the edit is published
  const auto claim_for = [&](const VoxelBox& box) {
    claim = ClaimFor("the edit", MostBrickBytes(box));
  };
  const auto change = [&](const VolumeSnapshot& volume) {
    CheckWanted(cancelled);
    return ApplyEdit(volume, edit, claim_for);
  };
  return Apply(change, expected, stroke);
}

EditOutcome VolumeEditor::Apply(const Change& change, const Revision& expected,
                                std::uint64_t stroke) {
  const auto lock = session_.LockVoxels();
  const auto volume = Begin(expected);
  const EditResult result = change(*volume);
  const VolumeState state = Publish(result);
  Record(volume, result, stroke);
  return Outcome(result, state);
}

std::optional<EditOutcome> VolumeEditor::Replace(const ReshapedVolume& filtered,
                                                 std::uint64_t revision) {
  const auto lock = session_.LockVoxels();
  const auto volume = Begin({});
  if (volume->revision() != revision) return std::nullopt;
  if (!HaveSameLattice(filtered.metadata, volume->metadata())) {
    return ReplaceWhole(volume, filtered.metadata, filtered.bricks);
  }
  const EditResult result = CompareBricks(*volume, volume->bricks().ChangesTo(filtered.bricks));
  const VolumeState state = Publish(result);
  Record(volume, result, 0);
  return Outcome(result, state);
}

EditOutcome VolumeEditor::Undo(const Revision& expected, const Cancelled& cancelled) {
  return Move(undo_, redo_, "there is no edit left to take back", expected, cancelled);
}

EditOutcome VolumeEditor::Redo(const Revision& expected, const Cancelled& cancelled) {
  return Move(redo_, undo_, "there is no edit to do again", expected, cancelled);
}

EditOutcome VolumeEditor::Revert(const Revision& expected, const Cancelled& cancelled) {
  const auto lock = session_.LockVoxels();
  const auto volume = Begin(expected);
  CheckWanted(cancelled);
  if (base_ && !HaveSameLattice(base_->metadata(), volume->metadata())) {
    const auto base = base_;
    return ReplaceWhole(volume, base->metadata(), base->bricks());
  }
  EditResult result;
  if (base_) result = CompareBricks(*volume, volume->bricks().ChangesTo(base_->bricks()));
  const VolumeState state = Publish(result);
  Record(volume, result, 0);
  return Outcome(result, state);
}

EditOutcome VolumeEditor::Move(Steps& from, Steps& to, const char* empty, const Revision& expected,
                               const Cancelled& cancelled) {
  const auto lock = session_.LockVoxels();
  const auto volume = Begin(expected);
  CheckWanted(cancelled);
  if (from.empty()) throw Error(ErrorKind::kConflict, empty);
  if (const auto whole = from.back().volume) {
    const VolumeState state = PublishWhole(whole->metadata(), whole->bricks());
    Drop(from, /*oldest=*/false);
    Push(to, {.bricks = {}, .volume = volume});
    return WholeOutcome(state);
  }
  std::vector<BrickChange> changes;
  for (const auto& [number, values] : from.back().bricks) {
    changes.push_back({volume->bricks().BrickOf(number), values});
  }
  // In the order in which an edit would have them.
  std::sort(changes.begin(), changes.end(), [&](const BrickChange& a, const BrickChange& b) {
    return volume->bricks().NumberOf(a.brick) < volume->bricks().NumberOf(b.brick);
  });
  const EditResult result = CompareBricks(*volume, changes);
  const VolumeState state = Publish(result);
  Step back{.bricks = {}, .stroke = from.back().stroke};
  Drop(from, /*oldest=*/false);
  Add(*volume, result, back);
  to.push_back(std::move(back));
  return Outcome(result, state);
}

std::shared_ptr<const VolumeSnapshot> VolumeEditor::Begin(const Revision& expected) {
  auto volume = session_.volume().volume;
  if (!volume) throw Error(ErrorKind::kUnavailable, "there is no volume yet");
  if (expected && *expected != volume->revision()) {
    throw Error(ErrorKind::kConflict,
                fmt::format("the volume is at revision {}, not {}: look at it again",
                            volume->revision(), *expected));
  }
  return volume;
}

VolumeState VolumeEditor::Publish(const EditResult& result) {
  if (result.changes.empty()) return session_.volume();
  const Mark mark(publishing_);
  return session_.PublishBricks(result.changes);
}

VolumeState VolumeEditor::PublishWhole(const VolumeMetadata& metadata,
                                       const BrickDirectory& bricks) {
  const Mark mark(publishing_);
  return session_.PublishReshaped(metadata, bricks);
}

EditOutcome VolumeEditor::ReplaceWhole(const std::shared_ptr<const VolumeSnapshot>& before,
                                       const VolumeMetadata& metadata,
                                       const BrickDirectory& bricks) {
  const VolumeState state = PublishWhole(metadata, bricks);
  BeginHistory(before);
  Push(undo_, {.bricks = {}, .volume = before});
  DropOldSteps();
  return WholeOutcome(state);
}

EditOutcome VolumeEditor::WholeOutcome(const VolumeState& state) const {
  const Vec3i& size = state.volume->size();
  return Outcome({.changes = {},
                  .changed = VoxelBox{Vec3i::Zero(), size - Vec3i::Ones()},
                  .changed_voxels = static_cast<std::uint64_t>(size.cast<std::int64_t>().prod())},
                 state);
}

EditOutcome VolumeEditor::Outcome(const EditResult& result, const VolumeState& state) const {
  return {.volume_revision = state.volume->revision(),
          .scene_revision = state.scene_revision,
          .changed = result.changed,
          .changed_voxels = result.changed_voxels,
          .undo_steps = undo_.size(),
          .redo_steps = redo_.size()};
}

void VolumeEditor::Record(const std::shared_ptr<const VolumeSnapshot>& before,
                          const EditResult& result, std::uint64_t stroke) {
  if (result.changes.empty()) return;
  BeginHistory(before);
  if (stroke == 0 || undo_.empty() || undo_.back().stroke != stroke) {
    undo_.push_back({.bricks = {}, .stroke = stroke});
  }
  Add(*before, result, undo_.back());
  DropOldSteps();
}

void VolumeEditor::BeginHistory(const std::shared_ptr<const VolumeSnapshot>& before) {
  if (!base_) base_ = before;
  while (!redo_.empty()) Drop(redo_, /*oldest=*/true);
}

void VolumeEditor::Push(Steps& steps, Step step) {
  steps.push_back(std::move(step));
  history_bytes_ += BytesOf(steps.back());
  SayHistoryBytes();
}

// The last one stays: whoever filters a large volume must be able to take that back.
void VolumeEditor::DropOldSteps() {
  while (history_bytes_ > max_history_bytes_ && undo_.size() > 1) Drop(undo_, /*oldest=*/true);
}

// What the step has of a brick already is older, and stays.
void VolumeEditor::Add(const VolumeSnapshot& before, const EditResult& result, Step& step) {
  history_bytes_ -= BytesOf(step);
  for (const BrickChange& change : result.changes) {
    const LeafPtr& leaf = before.bricks().At(change.brick);
    const bool is_new =
        step.bricks.try_emplace(before.bricks().NumberOf(change.brick), leaf).second;
    if (is_new) step.leaf_bytes += leaf->Bytes();
  }
  history_bytes_ += BytesOf(step);
  SayHistoryBytes();
}

// Freed by another thread: it may be large.
void VolumeEditor::Drop(Steps& steps, bool oldest) {
  Step& step = oldest ? steps.front() : steps.back();
  history_bytes_ -= BytesOf(step);
  session_.retired().Add(std::make_shared<const Step>(std::move(step)));
  if (oldest) {
    steps.pop_front();
  } else {
    steps.pop_back();
  }
  SayHistoryBytes();
}

MemoryClaim VolumeEditor::ClaimFor(const std::string& holder, std::uint64_t bytes) {
  MemoryBudget& budget = *session_.loader().budget;
  const std::uint64_t left = budget.left_bytes();
  std::uint64_t missing = bytes - std::min(bytes, left), dropped = 0;
  const auto count = [&](const Steps& steps) {
    for (const Step& step : steps) dropped += FreedWith(step);
  };
  if (missing > 0) {
    count(redo_);
    count(undo_);
    if (dropped < missing) missing = 0;  // not even all of them would help
  }
  while (missing > 0) {
    Steps& steps = redo_.empty() ? undo_ : redo_;
    missing -= std::min(missing, FreedWith(steps.front()));
    Drop(steps, /*oldest=*/true);
  }
  return budget.Claim(holder, bytes, kFreeingPatience);
}

// What the loaded volume, or somebody else, has too is not freed with the step.
std::uint64_t VolumeEditor::FreedWith(const Step& step) {
  std::uint64_t bytes = 0;
  if (step.volume && step.volume.use_count() == 1) bytes += step.volume->bricks().MemoryBytes();
  for (const auto& [number, leaf] : step.bricks) {
    if (leaf->use_count() == 1) bytes += leaf->Bytes();
  }
  return bytes;
}

void VolumeEditor::SayHistoryBytes() {
  session_.loader().budget->SetPart("edits to undo", history_bytes_);
}

std::uint64_t VolumeEditor::BytesOf(const Step& step) {
  constexpr std::uint64_t kBytesPerEntry = 48;  // of the map
  return step.leaf_bytes + step.bricks.size() * kBytesPerEntry +
         (step.volume ? step.volume->bricks().MemoryBytes() : 0);
}

std::uint64_t VolumeEditor::HistoryBytes() {
  const auto lock = session_.LockVoxels();
  return history_bytes_;
}

// Other voxels, and another volume, are published by who holds their lock. A scene with the voxels
// of the one before may come from anyone.
void VolumeEditor::OnScene(const Scene& scene, std::span<const BrickChange> changes) {
  const bool loaded = scene.volume->loaded_revision() != loaded_revision_;
  loaded_revision_ = scene.volume->loaded_revision();
  if ((loaded || !changes.empty()) && !publishing_) Forget();
}

void VolumeEditor::Forget() {
  RetiredVolumes& retired = session_.retired();
  retired.Add(std::exchange(base_, nullptr));
  if (!undo_.empty()) retired.Add(std::make_shared<const Steps>(std::exchange(undo_, {})));
  if (!redo_.empty()) retired.Add(std::make_shared<const Steps>(std::exchange(redo_, {})));
  history_bytes_ = 0;
  SayHistoryBytes();
}

}  // namespace palpate
