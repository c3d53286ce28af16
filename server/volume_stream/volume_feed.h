// Chooses the messages for one subscriber of the volume. The transport is elsewhere.
//
// The feed keeps no history and no queue, only the revision of the subscriber's copy. The newest
// volume knows which bricks have changed since that revision; the feed sends those bricks.
//
// The feed holds a volume while it sends that volume's revision. If the subscriber stops reading
// and a newer revision exists, the feed releases the volume. When the subscriber reads again, it
// gets the bricks that it lacks of the newest revision; bricks that it already has are not sent
// again. A stalled subscriber therefore costs a few numbers, whatever happens to the volume.
//
// Order of the events of one revision:
//   1. lattice, if the subscriber has another volume
//   2. placement, if the subscriber does not have the present one
//   3. after a lattice: the overview, then the bricks that are not all background;
//      otherwise: the changed bricks. Bricks travel in their own type; bricks of one value that
//      follow each other are one tile.
//   4. complete
//
// Threads: one at a time. Not real-time: it allocates, compresses, and may free a volume. Each
// Step does a bounded amount of work (some milliseconds), so that many feeds can take turns.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/bricks/brick.h"
#include "common/bricks/volume_event.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// Computes a coarse picture of a volume: the means of blocks of 4³ voxels.
//
// Threads: pure. Not real-time.

// The number of blocks along each axis.
Vec3i OverviewSize(const Vec3i& size_voxels);

// Computes the content hash that a volume would have if all its voxels were background.
//
// A client starts from this hash, so it hashes only the bricks that came. A lattice of 2048³ voxels
// takes about 1.5 s, so the work is done in pieces, once per volume.
//
// Threads: one at a time.
class BackgroundHash {
 public:
  BackgroundHash(std::uint64_t bricks, float background) : bricks_(bricks) {
    background_.fill(background);
  }

  // Hashes at most `most` more bricks. Returns true if the hash is complete.
  bool Advance(std::uint64_t most) {
    const std::uint64_t end = std::min(bricks_, next_ + most);
    for (; next_ < end; ++next_) hash_ += HashOfBrick(background_, next_);
    return next_ == bricks_;
  }
  const ContentHash& hash() const { return hash_; }

 private:
  const std::uint64_t bricks_;
  Brick background_;
  std::uint64_t next_ = 0;
  ContentHash hash_;
};

// The newest volume and its placement.
struct VolumeNow {
  std::shared_ptr<const VolumeSnapshot> volume;
  AffineMap X_DI;
  std::uint64_t settings_revision = 0;  // of the settings that set X_DI, or later
  std::string patient_axes{};           // of the file or answered, as in VolumeMetadata
  bool replayed = false;                // of a recording that is replayed
  // Of this volume's lattice, shared by all feeds. Null: the feed computes its own.
  std::shared_ptr<BackgroundHash> background_hash{};
};

std::shared_ptr<BackgroundHash> BackgroundHashOf(const VolumeSnapshot& volume);

struct VolumeFeedOptions {
  std::uint64_t max_unacknowledged = 0;  // 1 to 64; 0: 4
  std::optional<VolumeRevision> resume_from{};
};

class VolumeFeed {
 public:
  using Clock = std::chrono::steady_clock;

  // After a pause longer than this, the feed releases an old volume.
  static constexpr std::chrono::seconds kStall{2};
  // The feed releases an old volume after this time, also while the subscriber reads: the bricks
  // of old volumes count against the memory of those who edit.
  static constexpr std::chrono::seconds kLongestOld{30};

  // Errors: kInvalidArgument if the window is out of range, or if resume_from names a revision
  // that this daemon has not reached yet.
  VolumeFeed(const VolumeFeedOptions& options, std::uint64_t daemon_id, const VolumeNow& now,
             Clock::time_point time);

  // The subscriber has taken this message and all before it.
  void Acknowledge(std::uint64_t message_number, Clock::time_point time);

  // True if the window is open and the subscriber's copy or placement is not that of `now`.
  bool HasWork(const VolumeNow& now) const;
  // Does the next piece of work. Returns a message if there is one to send. Call it only if
  // HasWork.
  std::optional<VolumeMessage> Step(const VolumeNow& now, Clock::time_point time);

  // Releases a volume that is no longer the newest. Call it from time to time while Step is not
  // called (the window is closed or the transport is busy).
  void LetGo(const VolumeNow& now, Clock::time_point time);

  // The volume that the feed is sending; null: none.
  const VolumeSnapshot* held() const { return transfer_ ? transfer_->volume.get() : nullptr; }

 private:
  enum class Phase { kLattice, kSelect, kOverview, kBricks };

  // One revision that is being sent.
  struct Transfer {
    std::shared_ptr<const VolumeSnapshot> volume;
    bool replayed = false;  // of a replay
    Phase phase = Phase::kBricks;
    std::uint64_t selected = 0;    // bricks below this number are in `runs`, or need not be sent
    std::vector<BrickRun> runs{};  // bricks to send, from run `next` on
    std::size_t next = 0;
    std::uint64_t left = 0;  // bricks in these runs
    std::uint64_t sent = 0;  // all bricks below this number that are to be sent are sent
  };

  // What the subscriber got of revisions that were released before they were complete.
  struct Partial {
    std::uint64_t end = 0;       // of bricks below this number
    std::uint64_t revision = 0;  // the subscriber has this revision, or a newer one
  };

  bool IsOpen() const { return sent_ - acknowledged_ < window_; }
  bool IsBehind(const VolumeNow& now) const;
  bool IsMisplaced(const VolumeNow& now) const;
  void Begin(const VolumeNow& now);
  void KeepPartial();
  bool HasGot(const BrickDirectory& bricks, std::uint64_t number) const;
  std::optional<VolumeEvent> NextEvent(const VolumeNow& now);
  VolumeEvent TakeLattice();
  void Select();
  VolumeEvent TakeOverview();
  void BeginBricks();
  VolumeEvent TakeBricks();
  void HasSentBricks();
  std::optional<VolumeEvent> TakeComplete();

  std::uint64_t daemon_id_;
  std::uint64_t window_;
  // The revision of the last `complete`; none if the subscriber started from background.
  std::optional<std::uint64_t> revision_;
  Partial partial_;  // besides
  // The loaded_revision of the volume whose lattice the subscriber has.
  std::optional<std::uint64_t> loaded_revision_;
  std::uint64_t overview_sent_ = 0;  // its overview's blocks
  std::optional<AffineMap> X_DI_;    // the subscriber's placement
  std::string patient_axes_;         // of that placement
  bool replayed_ = false;            // of that placement
  bool placed_last_ = false;         // the last step sent a placement
  bool told_complete_ = false;       // on this stream
  std::optional<Transfer> transfer_;
  // Of the volume that is sent, or was sent last.
  std::shared_ptr<BackgroundHash> background_hash_;
  // All bricks of this revision are sent; this is the next event, without the background's hash.
  std::optional<VolumeComplete> complete_;

  std::uint64_t sent_ = 0;
  std::uint64_t acknowledged_ = 0;
  Clock::time_point progress_;  // of the last message or acknowledgement
  // When LetGo first found that the volume being sent is old; none: it is not.
  std::optional<Clock::time_point> old_since_;
};

}  // namespace palpate
