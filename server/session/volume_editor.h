// Changes the voxels of the session's volume, and takes changes back.
//
// A step of the history holds the bricks that a change replaced, and nothing else:
// bricks are shared, so that a step costs what it touched. One that made another lattice holds the
// volume before it. The last step is kept whatever it takes, those before it up to a limit. Undoing
// a step makes the step that does it again. Whoever changes voxels for people goes through here;
// when others do (a volume that is loaded, a frame of a series), the history ends,
// and Revert leads back to what they made.
//
// Threads: any ordinary thread. The history changes within the store's transaction that changes
// the voxels, so that it always fits them.
// Ownership: borrows the session, which tells it of every scene: construct it before the
// first Load, and end whoever publishes before it. Errors: Error; nothing changes then,
// except for kUnavailable where the servo does not answer.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <unordered_map>

#include "server/session/session.h"
#include "server/volume/edit.h"
#include "server/volume/reshape.h"

namespace palpate {

struct EditOutcome {
  std::uint64_t volume_revision = 0;  // the one before where no voxel changed
  std::uint64_t scene_revision = 0;   // for Session::WaitForServo
  std::optional<VoxelBox> changed{};  // around the voxels that changed
  std::uint64_t changed_voxels = 0;
  std::size_t undo_steps = 0;
  std::size_t redo_steps = 0;
};

class VolumeEditor final : public SceneListener {
 public:
  using Revision = std::optional<std::uint64_t>;
  // Whether nobody waits for the change any more; asked in its turn.
  using Cancelled = std::function<bool()>;
  // The changes to make to the volume as it is.
  using Change = std::function<EditResult(const VolumeSnapshot& volume)>;

  static constexpr std::uint64_t kHistoryBytes = std::uint64_t{256} << 20;

  explicit VolumeEditor(Session& session, std::uint64_t max_history_bytes = kHistoryBytes);

  // Each publishes without waiting for the servo. `expected`: the volume revision
  // to change; kConflict for another one. Successive changes of the same stroke
  // other than 0 become one step.
  EditOutcome Edit(const VolumeEdit& edit, const Revision& expected = {}, std::uint64_t stroke = 0,
                   const Cancelled& cancelled = {});
  // `change` claims the memory that its bricks take: ClaimFor.
  EditOutcome Apply(const Change& change, const Revision& expected = {}, std::uint64_t stroke = 0);
  // By `before`, filtered as a whole (reshape.h). None: the volume is another one by now. kConflict
  // as CheckLatticeMayChange.
  std::optional<EditOutcome> Replace(const VolumeSnapshot& before, const ReshapedVolume& filtered);
  // kConflict where there is nothing to take back, or to do again; kCancelled.
  EditOutcome Undo(const Revision& expected = {}, const Cancelled& cancelled = {});
  EditOutcome Redo(const Revision& expected = {}, const Cancelled& cancelled = {});
  // To the voxels as loaded; can be undone.
  EditOutcome Revert(const Revision& expected = {}, const Cancelled& cancelled = {});

  // In a transaction, as in Apply: memory for bricks that are about to be made.
  // Where there is too little, steps that can be done again go, and the oldest that can be undone,
  // if that helps. kTooLarge, and then none has gone.
  MemoryClaim ClaimFor(const std::string& holder, std::uint64_t bytes);

  // In a transaction. kConflict: a frame of a series is shown, or a recording replayed.
  void CheckLatticeMayChange() const;

  // The tick at which an outcome is felt. kUnavailable.
  AppliedTick Wait(const EditOutcome& outcome) {
    return session_.WaitForServo(outcome.scene_revision);
  }

  // Of the history, once a volume is loaded.
  std::uint64_t HistoryBytes();

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;

 private:
  struct Step {
    // What to put back, by number of the brick.
    std::unordered_map<std::uint64_t, LeafPtr> bricks;
    std::uint64_t leaf_bytes = 0;
    std::uint64_t stroke = 0;
    // Instead, where the lattice was another one.
    std::shared_ptr<const VolumeSnapshot> volume{};
  };
  using Steps = std::deque<Step>;

  static std::uint64_t BytesOf(const Step& step);

  // What one transaction makes: changes, or another lattice.
  struct Made {
    Made(EditResult of_bricks = {}) : result(std::move(of_bricks)) {}
    explicit Made(ReshapedVolume of_all);

    EditResult result{};
    std::optional<ReshapedVolume> whole{};
    // Tells the history, once nothing can fail any more.
    std::function<void(const EditResult& result)> note{};
  };
  using Make = std::function<Made(const std::shared_ptr<const VolumeSnapshot>& present)>;
  EditOutcome Transact(const Revision& expected, const Make& make);
  EditOutcome Move(Steps& from, Steps& to, const char* empty, const Revision& expected,
                   const Cancelled& cancelled);
  void Record(const std::shared_ptr<const VolumeSnapshot>& before, const EditResult& result,
              std::uint64_t stroke);
  void Add(const VolumeSnapshot& before, const EditResult& result, Step& step);
  // The present volume becomes `next`: by changes, where its lattice stays.
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

  // Changed and read within transactions.
  std::shared_ptr<const VolumeSnapshot> base_;  // before the first step
  Steps undo_;                                  // oldest first
  Steps redo_;
  std::uint64_t history_bytes_ = 0;
  std::uint64_t own_revision_ = 0;  // the newest that an edit of its own leads to

  // Of the scene before. Only OnScene has it, and the session calls that in turn.
  std::uint64_t loaded_revision_ = 0;

  const Listening listening_{session_, *this};
};

}  // namespace palpate
