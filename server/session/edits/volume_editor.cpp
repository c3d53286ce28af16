#include "server/session/edits/volume_editor.h"

#include <fmt/core.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

// The volume to show again. Only the volume as loaded can be loaded again.
ReshapedVolume AsItIs(const VolumeSnapshot& volume) {
  ReshapedVolume as_it_is{volume.metadata(), volume.bricks()};
  as_it_is.metadata.reloadable &= volume.revision() == volume.loaded_revision();
  return as_it_is;
}

bool HaveSameLattice(const VolumeMetadata& one, const VolumeMetadata& other) {
  return one.size == other.size && one.spacing_mm == other.spacing_mm &&
         one.origin_W_mm == other.origin_W_mm && one.value_min == other.value_min &&
         one.value_max == other.value_max && one.grid_form == other.grid_form;
}

// No changes if the lattice is another one.
EditResult ChangesTo(const VolumeSnapshot& before, const ReshapedVolume& after) {
  if (!HaveSameLattice(before.metadata(), after.metadata)) return {};
  return CompareBricks(before, before.bricks().ChangesTo(after.bricks));
}

// An edit may get its turn late. If its client no longer waits, the edit is not made.
void CheckWanted(const VolumeEditor::Cancelled& cancelled) {
  if (cancelled && cancelled()) throw Error(ErrorKind::kCancelled, "the edit was cancelled");
}

}  // namespace

VolumeEditor::VolumeEditor(Session& session, std::uint64_t max_history_bytes)
    : session_(session), max_history_bytes_(max_history_bytes) {}

VolumeEditor::Made::Made(ReshapedVolume of_all) : whole(std::move(of_all)) {
  const Vec3i& size = whole->metadata.size;
  result.changed = IndexBox{Vec3i::Zero(), size - Vec3i::Ones()};
  result.changed_voxels = static_cast<std::uint64_t>(size.cast<std::int64_t>().prod());
}

EditOutcome VolumeEditor::Edit(const VolumeEdit& edit, const Revision& expected,
                               const Stroke& stroke, const Cancelled& cancelled,
                               const LoadProgress& progress) {
  // Loads are refused meanwhile, rather than that they wait for a large edit.
  std::unique_lock<std::mutex> loading;
  if (progress) loading = session_.BeginLoad();
  MemoryClaim claim;  // held until the edit is published
  EditCalls calls;
  calls.box_known = [&](const IndexBox& box) { claim = ClaimFor("the edit", MostBrickBytes(box)); };
  if (progress) {
    calls.progress = [&](double share) {
      CheckWanted(cancelled);
      progress("editing", share);
    };
  }
  const auto change = [&](const VolumeSnapshot& volume) {
    CheckWanted(cancelled);
    if (!stroke.acts_once) return ApplyEdit(volume, edit, calls);
    return ApplyEditOnce(GoesOn(stroke) ? *before_stroke_ : volume, volume, edit, calls);
  };
  return Apply(change, expected, stroke);
}

EditOutcome VolumeEditor::Apply(const Change& change, const Revision& expected,
                                const Stroke& stroke) {
  return Transact(expected, [&](const std::shared_ptr<const VolumeSnapshot>& present) -> Made {
    Made made(change(*present));
    made.goes_on = GoesOn(stroke);
    made.note = [this, present, stroke](const EditResult& result) {
      Record(present, result, stroke);
    };
    return made;
  });
}

std::optional<EditOutcome> VolumeEditor::Replace(const VolumeSnapshot& before,
                                                 const ReshapedVolume& filtered) {
  // Compared outside the transaction, because it may take seconds and other editors would wait.
  EditResult changes = ChangesTo(before, filtered);
  bool is_late = false;
  const auto make = [&](const std::shared_ptr<const VolumeSnapshot>& present) -> Made {
    is_late = present->revision() != before.revision();
    if (is_late) return {};
    return MakeAll(present, filtered, std::move(changes));
  };
  const EditOutcome outcome = Transact({}, make);
  if (is_late) return std::nullopt;
  return outcome;
}

EditOutcome VolumeEditor::Undo(const Revision& expected, const Cancelled& cancelled) {
  return Move(undo_, redo_, "there is no edit left to undo", expected, cancelled);
}

EditOutcome VolumeEditor::Redo(const Revision& expected, const Cancelled& cancelled) {
  return Move(redo_, undo_, "there is no edit to redo", expected, cancelled);
}

EditOutcome VolumeEditor::Revert(const Revision& expected, const Cancelled& cancelled) {
  return Transact(expected, [&](const std::shared_ptr<const VolumeSnapshot>& present) -> Made {
    CheckWanted(cancelled);
    if (!base_) return {};
    const ReshapedVolume base = AsItIs(*base_);
    return MakeAll(present, base, ChangesTo(*present, base));
  });
}

std::shared_ptr<const VolumeSnapshot> VolumeEditor::AsLoaded() const {
  std::shared_ptr<const VolumeSnapshot> base;
  session_.store().Edit([&](const std::shared_ptr<const VolumeSnapshot>&) {
    base = base_;
    return VolumeChange();
  });
  return base;
}

void VolumeEditor::CheckLatticeMayChange() const {
  if (session_.store().shows_series()) {
    throw Error(ErrorKind::kConflict,
                "the lattice of a series cannot change: load the frame alone, as a volume");
  }
}

VolumeEditor::Made VolumeEditor::MakeAll(const std::shared_ptr<const VolumeSnapshot>& present,
                                         const ReshapedVolume& next, EditResult changes) {
  if (HaveSameLattice(next.metadata, present->metadata())) {
    Made made(std::move(changes));
    made.note = [this, present](const EditResult& result) { Record(present, result, {}); };
    return made;
  }
  CheckLatticeMayChange();
  Made made(next);
  made.note = [this, present](const EditResult&) {
    BeginHistory(present);
    Push(undo_, {.bricks = {}, .volume = present});
    DropOldSteps();
  };
  return made;
}

EditOutcome VolumeEditor::Move(Steps& from, Steps& to, const char* empty, const Revision& expected,
                               const Cancelled& cancelled) {
  return Transact(expected, [&](const std::shared_ptr<const VolumeSnapshot>& present) -> Made {
    CheckWanted(cancelled);
    if (from.empty()) throw Error(ErrorKind::kConflict, empty);
    if (const auto whole = from.back().volume) {
      CheckLatticeMayChange();
      Made made(AsItIs(*whole));
      made.note = [this, present, &from, &to](const EditResult&) {
        Drop(from, /*oldest=*/false);
        Push(to, {.bricks = {}, .volume = present});
      };
      return made;
    }
    const BrickDirectory& bricks = present->bricks();
    std::vector<BrickChange> changes;
    for (const auto& [number, values] : from.back().bricks) {
      changes.push_back({bricks.BrickOf(number), values});
    }
    // Sorted as an edit would sort them.
    std::sort(changes.begin(), changes.end(), [&](const BrickChange& a, const BrickChange& b) {
      return bricks.NumberOf(a.brick) < bricks.NumberOf(b.brick);
    });
    Made made(CompareBricks(*present, changes));
    made.note = [this, present, &from, &to](const EditResult& result) {
      Step back{.bricks = {}, .stroke = from.back().stroke};
      session_.retired().Add(std::exchange(before_stroke_, nullptr));
      Drop(from, /*oldest=*/false);
      Add(*present, result, back);
      to.push_back(std::move(back));
    };
    return made;
  });
}

EditOutcome VolumeEditor::Transact(const Revision& expected, const Make& make) {
  EditOutcome outcome;
  const auto change = [&](const std::shared_ptr<const VolumeSnapshot>& present) {
    session_.RequireNoReplay();
    if (expected && *expected != present->revision()) {
      throw Error(ErrorKind::kConflict,
                  fmt::format("the volume is at revision {}, not {}: read it again",
                              present->revision(), *expected));
    }
    const auto made = std::make_shared<Made>(make(present));
    outcome.changed = made->result.changed;
    outcome.changed_voxels = made->result.changed_voxels;
    VolumeChange next =
        made->whole ? VolumeChange(std::move(*made->whole)) : VolumeChange(made->result.changes);
    next.kind = made->goes_on ? VolumeChange::Kind::kGoesOn : VolumeChange::Kind::kEdit;
    next.before_publication = [&](std::uint64_t revision) { own_revision_ = revision; };
    next.after_publication = [&, made] {
      if (made->note) made->note(made->result);
      outcome.undo_steps = undo_.size();
      outcome.redo_steps = redo_.size();
    };
    return next;
  };
  const EditedRevisions revisions = session_.store().Edit(change);
  outcome.volume_revision = revisions.volume;
  outcome.scene_revision = revisions.scene;
  return outcome;
}

void VolumeEditor::Record(const std::shared_ptr<const VolumeSnapshot>& before,
                          const EditResult& result, const Stroke& stroke) {
  if (result.changes.empty()) return;
  BeginHistory(before);
  if (!GoesOn(stroke)) {
    undo_.push_back({.bricks = {}, .stroke = stroke});
    session_.retired().Add(std::exchange(before_stroke_, stroke.acts_once ? before : nullptr));
  }
  Add(*before, result, undo_.back());
  DropOldSteps();
}

bool VolumeEditor::GoesOn(const Stroke& stroke) const {
  return stroke.number != 0 && !undo_.empty() && undo_.back().stroke == stroke &&
         stroke.acts_once == (before_stroke_ != nullptr);
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

// Keeps the last step: a user who filters a large volume must be able to undo it.
void VolumeEditor::DropOldSteps() {
  while (history_bytes_ > max_history_bytes_ && undo_.size() > 1) Drop(undo_, /*oldest=*/true);
}

// If the step already holds a brick, its copy is older and stays.
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

// Another thread frees the step, because it may be large.
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
    if (dropped < missing) missing = 0;  // dropping all of them would not be enough
  }
  while (missing > 0) {
    Steps& steps = redo_.empty() ? undo_ : redo_;
    missing -= std::min(missing, FreedWith(steps.front()));
    Drop(steps, /*oldest=*/true);
  }
  return budget.Claim(holder, bytes);
}

// Counts only leaves that nobody else holds: only these are freed with the step. For another
// lattice the number is unknown, so it counts as 0.
std::uint64_t VolumeEditor::FreedWith(const Step& step) {
  std::uint64_t bytes = 0;
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
  std::uint64_t bytes = 0;
  session_.store().Edit([&](const auto&) {
    bytes = history_bytes_;
    return std::vector<BrickChange>();
  });
  return bytes;
}

// Changed voxels always come in a transaction. A scene with unchanged voxels may come from any
// caller at any time.
void VolumeEditor::OnScene(const Scene& scene, std::span<const BrickChange> changes) {
  const bool loaded = scene.volume->loaded_revision() != loaded_revision_;
  loaded_revision_ = scene.volume->loaded_revision();
  const bool others = loaded || !changes.empty();
  if (others && scene.volume->revision() != own_revision_) Forget();
}

void VolumeEditor::Forget() {
  RetiredVolumes& retired = session_.retired();
  retired.Add(std::exchange(base_, nullptr));
  retired.Add(std::exchange(before_stroke_, nullptr));
  if (!undo_.empty()) retired.Add(std::make_shared<const Steps>(std::exchange(undo_, {})));
  if (!redo_.empty()) retired.Add(std::make_shared<const Steps>(std::exchange(redo_, {})));
  history_bytes_ = 0;
  SayHistoryBytes();
}

}  // namespace palpate
