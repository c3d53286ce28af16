// The volume that is felt, and the one way to change it.
//
// A change is a transaction: it makes the next snapshot of the present one, and has it published
// before another change begins. So scenes come in the order of the volume's revisions: 1, 2, 3, ...
// What it replaces is retired, and freed by another thread.
//
// Threads: any ordinary thread; never the servo's. Transactions wait for each other, readers
// (Session::volume) for none: a filter, which computes its last part in one, may take 20 s at
// worst; nobody else may wait for anything in one. The lock is taken before the session's, so
// that a transaction may ask the session; none begins another one.
// Ownership: shares the budget. Errors: Error; nothing changes then.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "server/store/memory_budget.h"
#include "server/store/retired_volumes.h"
#include "server/volume/reshape.h"
#include "server/volume/snapshot.h"

namespace palpate {

// Without the snapshot: who holds an old one keeps its bricks from being freed.
struct EditedRevisions {
  std::uint64_t volume = 0;
  std::uint64_t scene = 0;  // for Session::WaitForServo
};

// What a transaction makes of the present volume. Memory has been claimed for it.
struct VolumeChange {
  // Of so many bricks. None: nothing is published.
  VolumeChange(std::vector<BrickChange> replaced = {}) : bricks(std::move(replaced)) {}
  // Another lattice, of the same volume.
  explicit VolumeChange(ReshapedVolume other) : whole(std::move(other)) {}

  std::vector<BrickChange> bricks{};
  std::optional<ReshapedVolume> whole{};
  // Called in the transaction when the snapshot is made, with its revision (the present
  // one's where nothing changes): what others note of the change fits it then.
  std::function<void(std::uint64_t revision)> before_publication{};
};

class VolumeStore {
 public:
  using Change = std::function<VolumeChange(const std::shared_ptr<const VolumeSnapshot>& present)>;
  // Publishes a scene with this volume, which is the one before but for these bricks or has another
  // lattice, unless it is felt already. Returns the revision of the newest scene.
  using Publish = std::function<std::uint64_t(const std::shared_ptr<const VolumeSnapshot>& volume,
                                              std::span<const BrickChange> changes)>;

  // `collect`: as for RetiredVolumes. `publish`: for Edit.
  VolumeStore(std::shared_ptr<MemoryBudget> budget, std::function<void()> collect, Publish publish);
  ~VolumeStore();
  VolumeStore(const VolumeStore&) = delete;
  VolumeStore& operator=(const VolumeStore&) = delete;

  // What `change` throws ends the transaction. kUnavailable before the first volume.
  EditedRevisions Edit(const Change& change);

  // Another volume; `publish`, which gets no changes, may refuse it. `frames_bytes`: of all frames,
  // where it is one of several that are in memory; for messages.
  void Replace(const VolumeMetadata& metadata, const BrickDirectory& bricks,
               std::uint64_t frames_bytes, const Publish& publish);

  // While one exists, the frames of a series wait. For a replay, whose voxels are not those of
  // any frame.
  class Hold {
   public:
    explicit Hold(VolumeStore& store) : store_(store) { store_.SetHeld(true); }
    ~Hold() { store_.SetHeld(false); }
    Hold(const Hold&) = delete;
    Hold& operator=(const Hold&) = delete;

   private:
    VolumeStore& store_;
  };
  // In a transaction.
  bool is_held() const { return is_held_; }
  bool shows_series() const { return frames_bytes_ > 0; }

  // For volumes, and what else holds many bricks, that nobody shows any more.
  RetiredVolumes& retired() { return retired_; }

 private:
  std::shared_ptr<const VolumeSnapshot> Next(const VolumeChange& change) const;
  EditedRevisions Put(std::shared_ptr<const VolumeSnapshot> next,
                      std::span<const BrickChange> changes, std::uint64_t frames_bytes,
                      const Publish& publish);
  void SetHeld(bool held);

  const std::shared_ptr<MemoryBudget> budget_;
  const Publish publish_;

  std::mutex mutex_;                               // held for each transaction; guards what follows
  std::shared_ptr<const VolumeSnapshot> present_;  // null: none yet
  std::uint64_t frames_bytes_ = 0;                 // of the series that present_ is of; 0: of none
  bool is_held_ = false;

  RetiredVolumes retired_;  // its thread ends first
};

}  // namespace palpate
