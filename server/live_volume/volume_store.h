// The volume that is felt, and the one way to change it.
//
// A change is a transaction: it makes the next snapshot from the present one and publishes the
// next one before another change begins. Scenes therefore come in the order of the volume's
// revisions: 1, 2, 3, ... Another thread frees the replaced snapshot.
//
// Threads: any ordinary thread; never the servo's. Transactions wait for each other. Readers
// (Session::volume) never wait for a transaction. A filter computes its last part in a
// transaction, which may take 20 s at worst; no other transaction may wait for anything. The
// store's lock is taken before the session's lock, so a transaction may query the session. A
// transaction must not begin another one.
// Ownership: shares the budget. Errors: Error; the volume is unchanged then.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "server/live_volume/memory_budget.h"
#include "server/volume/edit/reshape.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// Frees replaced volumes on a thread of its own.
//
// Freeing a volume of one gigabyte takes half a second. Code that replaces a volume therefore hands
// the old volume over here. The thread frees the volume when it is the only holder left, so that
// the servo, a stream, a recording or a call never has to free a volume.
//
// Threads: any ordinary thread. Only WaitForFreed waits for the freeing thread.
class RetiredVolumes {
 public:
  // `collect`: releases what the servo and the pump no longer use. The thread calls it before each
  // check.
  explicit RetiredVolumes(std::function<void()> collect);
  // Releases everything.
  ~RetiredVolumes();
  RetiredVolumes(const RetiredVolumes&) = delete;
  RetiredVolumes& operator=(const RetiredVolumes&) = delete;

  // Takes a volume, or an object that holds bricks of a volume. Ignores null.
  void Add(std::shared_ptr<const void> retired);

  // Waits until everything added is freed and returned to the system. Gives up after `patience`,
  // or after a tenth of a second in which others still hold all that is left.
  void WaitForFreed(std::chrono::milliseconds patience);

 private:
  using Holders = std::vector<std::shared_ptr<const void>>;

  void Run();
  // Frees what has no other holder and returns the rest. Call it without the lock.
  Holders Look(Holders retired);

  const std::function<void()> collect_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::condition_variable looked_;
  Holders retired_;
  bool is_looking_ = false;  // the thread has taken objects out of retired_
  int waiting_ = 0;
  int vain_looks_ = 0;  // checks in a row without success, while a caller waits
  bool stop_ = false;

  std::thread thread_;
};

// Holds no snapshot, because a caller that keeps an old snapshot keeps its bricks in memory.
struct EditedRevisions {
  std::uint64_t volume = 0;
  std::uint64_t scene = 0;  // for Session::WaitForServo
};

// The result of a transaction. The caller has already claimed memory for it.
struct VolumeChange {
  // Replaces these bricks. If there are none, and nothing below, the store makes no new snapshot.
  VolumeChange(std::vector<BrickChange> replaced = {}) : bricks(std::move(replaced)) {}
  // The same volume on another lattice.
  explicit VolumeChange(ReshapedVolume other) : whole(std::move(other)) {}

  std::vector<BrickChange> bricks{};
  std::optional<ReshapedVolume> whole{};
  // The same voxels in a snapshot with another revision, above the present one.
  std::shared_ptr<const VolumeSnapshot> renumbered{};
  std::optional<double> series_position_frames{};  // of the frame that it leads to
  // An edit of a user; kGoesOn if it belongs to the last edit. Others show a frame.
  enum class Kind : std::uint8_t { kOther, kEdit, kGoesOn } kind = Kind::kOther;
  // Called in the transaction, before the new snapshot is published and afterwards. `revision` is
  // the new snapshot's, or the present one's if nothing changes; 0 in a second call if the
  // publication fails.
  std::function<void(std::uint64_t revision)> before_publication{};
  std::function<void()> after_publication{};
};

class VolumeStore {
 public:
  using Change = std::function<VolumeChange(const std::shared_ptr<const VolumeSnapshot>& present)>;
  // Publishes a scene with this volume, unless the volume is already felt. The volume differs from
  // the previous one in `changes`, or in its lattice. Returns the revision of the newest scene.
  using Publish = std::function<std::uint64_t(const std::shared_ptr<const VolumeSnapshot>& volume,
                                              std::span<const BrickChange> changes)>;

  // `collect`: as for RetiredVolumes. `publish`: for Edit.
  VolumeStore(std::shared_ptr<MemoryBudget> budget, std::function<void()> collect, Publish publish);
  ~VolumeStore();
  VolumeStore(const VolumeStore&) = delete;
  VolumeStore& operator=(const VolumeStore&) = delete;

  // If `change` throws, the transaction ends and the error is passed on. Throws Error
  // (kUnavailable) before the first volume.
  EditedRevisions Edit(const Change& change);

  // Replaces the volume by another one. `publish` gets no changes and may refuse the volume by
  // throwing. `frames_bytes`: the size of all frames if the volume is a frame of a series, else 0;
  // used in messages. Throws as RequireSaved.
  void Replace(const VolumeMetadata& metadata, const BrickDirectory& bricks,
               std::uint64_t frames_bytes, bool discards_edits, const Publish& publish);

  // The number of edits since the voxels were loaded or saved. 0 if they are the same again.
  std::uint64_t unsaved_edits() const { return unsaved_edits_.load(); }
  // `told` is called with the number in every transaction that may change it. It must not wait.
  void TellEdits(std::function<void(std::uint64_t unsaved_edits)> told);
  // Throws kFailedPrecondition if there are any and they must not be discarded.
  void RequireSaved(bool discards_edits) const;
  // Call it when these voxels have been saved; nothing if they are of an earlier volume. A saved
  // frame does not count: a series has others.
  void Saved(const VolumeSnapshot& volume);

  // Call it only in a transaction.
  bool shows_series() const { return frames_bytes_ > 0; }

  // Takes replaced volumes, and other objects that hold many bricks.
  RetiredVolumes& retired() { return retired_; }

 private:
  std::shared_ptr<const VolumeSnapshot> Next(const VolumeChange& change) const;
  EditedRevisions Put(std::shared_ptr<const VolumeSnapshot> next,
                      std::span<const BrickChange> changes, std::uint64_t frames_bytes,
                      const Publish& publish);
  void Count(VolumeChange::Kind kind);
  void SetEdits(std::uint64_t unsaved_edits);

  const std::shared_ptr<MemoryBudget> budget_;
  const Publish publish_;

  std::mutex mutex_;                               // held for each transaction; guards what follows
  std::shared_ptr<const VolumeSnapshot> present_;  // null: none yet
  std::uint64_t frames_bytes_ = 0;                 // of the series that present_ is of; 0: of none
  std::uint64_t replaced_revision_ = 0;            // the first of this volume's
  ContentHash saved_;                              // of the voxels as loaded or saved
  std::atomic<std::uint64_t> unsaved_edits_ = 0;
  std::function<void(std::uint64_t)> told_;

  RetiredVolumes retired_;  // its thread ends first
};

}  // namespace palpate
