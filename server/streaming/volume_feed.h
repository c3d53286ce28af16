// What one subscriber of the volume gets, apart from the transport.
//
// There is no history and no queue: all that is kept of a subscriber is the
// revision that its copy has. What it lacks are the bricks that changed since,
// which the newest volume knows. While one revision is on its way its volume is
// held; a subscriber that stops reading loses that hold when there is a newer one,
// and later gets what it lacks of the one that is newest then, without what it had
// got of the first. So it costs a few numbers, whatever happens to the volume.
//
// Order of the events of one revision: lattice (of another volume than before),
// placement (where it is not known), overview and the bricks that are not all
// background (after a lattice), or the changed bricks; complete.
//
// Threads: one at a time. Not real-time: it allocates, compresses, and may free a
// volume. Each Step does a bounded amount of work, some milliseconds, so that many
// feeds can take turns.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/bricks/volume_event.h"
#include "server/volume/snapshot.h"

namespace palpate {

// The newest that there is.
struct VolumeNow {
  std::shared_ptr<const VolumeSnapshot> volume;
  AffineMap X_DI;
  std::uint64_t settings_revision = 0;  // that X_DI came with, or a later one
};

struct VolumeFeedOptions {
  std::uint64_t max_unacknowledged = 0;  // 1 to 64; 0: 4
  std::optional<VolumeRevision> resume_from{};
};

class VolumeFeed {
 public:
  using Clock = std::chrono::steady_clock;

  // Bricks of a message at most.
  static constexpr std::size_t kBricksPerMessage = 64;
  // A subscriber that takes nothing for longer does not hold an old volume.
  static constexpr std::chrono::seconds kStall{2};

  // Errors: kInvalidArgument for a window out of range, or a revision of this
  // daemon that is yet to come.
  VolumeFeed(const VolumeFeedOptions& options, std::uint64_t daemon_id, const VolumeNow& now,
             Clock::time_point time);

  // The subscriber has taken this message and all before it.
  void Acknowledge(std::uint64_t message_number, Clock::time_point time);

  // The window is open, and the copy or placement is not that of `now`.
  bool HasWork(const VolumeNow& now) const;
  // Does the next piece of work, which may end in a message to send. Only where
  // HasWork.
  std::optional<VolumeMessage> Step(const VolumeNow& now, Clock::time_point time);

  // To be called now and then while Step is not, as the window is closed or the
  // transport is busy: lets go of a volume that is no longer the newest.
  void LetGo(const VolumeNow& now, Clock::time_point time);

  // The volume that is on its way to this subscriber.
  const VolumeSnapshot* held() const { return transfer_ ? transfer_->volume.get() : nullptr; }

 private:
  enum class Phase { kLattice, kSelect, kOverview, kBricks };

  // One revision on its way.
  struct Transfer {
    std::shared_ptr<const VolumeSnapshot> volume;
    Phase phase = Phase::kBricks;
    std::uint64_t next = 0;                // brick to look at, then place in numbers
    std::vector<std::uint64_t> numbers{};  // of the bricks to send
  };

  // What came of revisions that were let go of.
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
  void LeaveOverview();
  VolumeEvent TakeBricks();
  VolumeEvent TakeComplete();
  void HasSentBricks();

  std::uint64_t daemon_id_;
  std::uint64_t window_;
  // Of the last `complete`; none where there was background before.
  std::optional<std::uint64_t> revision_;
  Partial partial_;  // besides
  // Of the volume whose lattice the subscriber has.
  std::optional<std::uint64_t> loaded_revision_;
  std::uint64_t overview_sent_ = 0;  // blocks of it
  std::optional<AffineMap> X_DI_;    // that it was told
  bool placed_last_ = false;         // by the last step
  bool told_complete_ = false;       // on this stream
  std::optional<Transfer> transfer_;
  // Its bricks have been sent: to be said next.
  std::optional<VolumeComplete> complete_;

  std::uint64_t sent_ = 0;
  std::uint64_t acknowledged_ = 0;
  Clock::time_point progress_;  // of the last message or acknowledgement
};

}  // namespace palpate
