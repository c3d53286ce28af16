// Changes the voxels of the session's volume, and undoes and redoes changes.
//
// A step of the history holds only the bricks that a change replaced. Bricks are shared, so a step
// costs as much memory as the bricks it touched. A step that changed the lattice holds the whole
// earlier volume. The last step is always kept; earlier steps are kept up to a limit. Undoing a
// step makes a step to redo it.
// Every change made for a user goes through this class. If other code changes voxels (a loaded
// volume, a frame of a series), the history ends, and Revert leads back to the voxels after that
// change.
//
// Threads: any ordinary thread. The history changes in the same transaction of the store as the
// voxels, so both always fit together.
// Ownership: borrows and listens to the session. Construct it before the first Load, and stop all
// publishers before it is destroyed. Errors: Error; then nothing changes, except for kUnavailable
// if the servo does not answer.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <unordered_map>

#include "server/session/session.h"
#include "server/volume/edit/edit.h"
#include "server/volume/edit/reshape.h"

namespace palpate {

struct EditOutcome {
  std::uint64_t volume_revision = 0;  // unchanged if no voxel changed
  std::uint64_t scene_revision = 0;   // for Session::WaitForServo
  std::optional<IndexBox> changed{};  // the box around the changed voxels
  std::uint64_t changed_voxels = 0;
  std::size_t undo_steps = 0;
  std::size_t redo_steps = 0;
};

// Successive edits that are one step of the history. The number 0: the edit stands alone.
struct Stroke {
  std::uint64_t number = 0;
  bool acts_once = false;  // on each voxel: ApplyEditOnce. Otherwise its edits add up.
  friend bool operator==(const Stroke&, const Stroke&) = default;
};

class VolumeEditor final : public SceneListener {
 public:
  using Revision = std::optional<std::uint64_t>;
  // Returns true if nobody waits for the change any more. Asked when it is the change's turn.
  using Cancelled = std::function<bool()>;
  // Computes the changes to make to the present volume.
  using Change = std::function<EditResult(const VolumeSnapshot& volume)>;

  static constexpr std::uint64_t kHistoryBytes = std::uint64_t{256} << 20;

  explicit VolumeEditor(Session& session, std::uint64_t max_history_bytes = kHistoryBytes);

  // Each of these publishes without waiting for the servo. `expected`: the volume revision to
  // change; kConflict if the present revision is another one. Successive changes of the same stroke
  // become one step.
  // With `progress`, an edit may have any size and is cancelled at any time; other edits wait.
  EditOutcome Edit(const VolumeEdit& edit, const Revision& expected = {}, const Stroke& stroke = {},
                   const Cancelled& cancelled = {}, const LoadProgress& progress = {});
  // `change` must claim the memory for its bricks: ClaimFor.
  EditOutcome Apply(const Change& change, const Revision& expected = {}, const Stroke& stroke = {});
  // Replaces the volume by `filtered`, the result of filtering the whole volume `before`
  // (reshape.h). Returns none if the present volume is no longer `before`. Throws kConflict as
  // CheckLatticeMayChange.
  std::optional<EditOutcome> Replace(const VolumeSnapshot& before, const ReshapedVolume& filtered);
  // Throw kConflict if there is nothing to undo or redo; kCancelled.
  EditOutcome Undo(const Revision& expected = {}, const Cancelled& cancelled = {});
  EditOutcome Redo(const Revision& expected = {}, const Cancelled& cancelled = {});
  // Goes back to the voxels as loaded. Can be undone.
  EditOutcome Revert(const Revision& expected = {}, const Cancelled& cancelled = {});

  // Returns the voxels as loaded, if they were edited since; else nothing.
  std::shared_ptr<const VolumeSnapshot> AsLoaded() const;

  // Call it in a transaction, as in Apply. Claims memory for bricks that are about to be made. If
  // memory is short, drops steps to redo first, then the oldest steps to undo, if this frees
  // enough. Otherwise throws kTooLarge and drops none.
  MemoryClaim ClaimFor(const std::string& holder, std::uint64_t bytes);

  // Call it in a transaction. Throws kConflict if a frame of a series is shown.
  void CheckLatticeMayChange() const;

  // Returns the tick at which an outcome is felt. Throws kUnavailable.
  AppliedTick Wait(const EditOutcome& outcome) {
    return session_.WaitForServo(outcome.scene_revision);
  }

  // Memory of the history. Call it after the first load.
  std::uint64_t HistoryBytes();

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;

 private:
  struct Step {
    // The bricks to put back, by number.
    std::unordered_map<std::uint64_t, LeafPtr> bricks;
    std::uint64_t leaf_bytes = 0;
    Stroke stroke{};
    // Set instead of `bricks` if the lattice was another one.
    std::shared_ptr<const VolumeSnapshot> volume{};
  };
  using Steps = std::deque<Step>;

  static std::uint64_t BytesOf(const Step& step);

  // The result of one transaction: changes, or another lattice.
  struct Made {
    Made(EditResult of_bricks = {}) : result(std::move(of_bricks)) {}
    explicit Made(ReshapedVolume of_all);

    EditResult result{};
    std::optional<ReshapedVolume> whole{};
    bool goes_on = false;  // with the last step
    // Updates the history. Called when the change is published.
    std::function<void(const EditResult& result)> note{};
  };
  using Make = std::function<Made(const std::shared_ptr<const VolumeSnapshot>& present)>;
  EditOutcome Transact(const Revision& expected, const Make& make);
  EditOutcome Move(Steps& from, Steps& to, const char* empty, const Revision& expected,
                   const Cancelled& cancelled);
  void Record(const std::shared_ptr<const VolumeSnapshot>& before, const EditResult& result,
              const Stroke& stroke);
  bool GoesOn(const Stroke& stroke) const;
  void Add(const VolumeSnapshot& before, const EditResult& result, Step& step);
  // Makes the present volume equal to `next`. Uses `changes` if the lattice stays.
  Made MakeAll(const std::shared_ptr<const VolumeSnapshot>& present, const ReshapedVolume& next,
               EditResult changes);
  void BeginHistory(const std::shared_ptr<const VolumeSnapshot>& before);
  void Push(Steps& steps, Step step);
  void DropOldSteps();
  void Drop(Steps& steps, bool oldest);
  static std::uint64_t FreedWith(const Step& step);
  void SayHistoryBytes();
  void Forget();

  Session& session_;
  const std::uint64_t max_history_bytes_;

  // Changed and read only in transactions.
  std::shared_ptr<const VolumeSnapshot> base_;  // the volume before the first step
  Steps undo_;                                  // oldest first
  Steps redo_;
  // The volume before the last step, if this is a stroke that acts once and may go on.
  std::shared_ptr<const VolumeSnapshot> before_stroke_;
  std::uint64_t history_bytes_ = 0;
  std::uint64_t own_revision_ = 0;  // the newest revision made by this editor

  // The last scene's. Only OnScene uses it, and the session calls OnScene one at a time.
  std::uint64_t loaded_revision_ = 0;

  const Listening listening_{session_, *this};
};

}  // namespace palpate
