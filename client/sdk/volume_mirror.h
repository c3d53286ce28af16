// A copy of the daemon's volume, in its own type and as sparse as the daemon's. The messages of a
// stream keep it equal to the daemon's.
//
// At every `complete`, the copy's content hash is compared with the daemon's. So a copy that is
// complete equals the daemon's volume, voxel by voxel.
//
// Frames: I voxel indices, W world and D device frame (mm); values in data units.
// Threads: one at a time. Bricks that were handed out never change; read them on any thread.
// Errors: kInvalidArgument (messages that make no sense), kTooLarge (the volume is larger than
// allowed), kInternal (the copy is not equal). After an error the copy is void, as after Reset.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "common/bricks/brick_map.h"
#include "common/bricks/volume_event.h"

namespace palpate::client {

// The changes since the copy's owner asked last.
struct MirrorChanges {
  bool all = false;  // another volume: all bricks that are not in `bricks` are background
  std::vector<BrickRun> bricks{};  // changed bricks, ascending, apart from each other
};

class VolumeMirror {
 public:
  // The daemon takes no larger lattice.
  static constexpr std::uint64_t kMaxVoxels = std::uint64_t{1} << 36;

  explicit VolumeMirror(std::uint64_t max_voxels = kMaxVoxels) : max_voxels_(max_voxels) {}

  void Apply(const VolumeEvent& event);
  // Forgets the copy.
  void Reset();

  // The revision of the last `complete`, to resume from; none if all voxels are needed. Voxels
  // received since then are newer, and the daemon will send them again.
  const std::optional<VolumeRevision>& resume() const { return resume_; }
  // True if the copy is the volume of revision resume(). False while it changes to a newer
  // revision.
  bool is_complete() const { return is_complete_; }
  // The daemon's hash of the volume of revision resume().
  const ContentHash& content_hash() const { return content_hash_; }
  // Bricks still to come, as far as is known.
  std::uint64_t bricks_left() const { return bricks_left_; }

  // None before a volume began.
  const std::optional<VolumeLattice>& lattice() const { return lattice_; }
  // None before the stream has sent the placement of this volume.
  const std::optional<VolumePlacement>& placement() const { return placement_; }

  // Empty without a lattice. Bricks that did not come are background.
  const BrickMap& bricks() const { return bricks_; }
  const TypedBrickPtr& background() const { return background_; }
  // Means of blocks of 4³ voxels from when the volume began. Block (i, j, k) of overview_size() is
  // at (i size_y + j) size_z + k. Empty until the overview is complete.
  std::span<const float> overview() const;
  const Vec3i& overview_size() const { return overview_size_; }

  MirrorChanges TakeChanges();

 private:
  void Take(const VolumeLattice& lattice);
  void Take(const VolumePlacement& placement);
  void Take(const VolumeOverview& overview);
  void Take(const VolumeBricks& bricks);
  void Take(const VolumeComplete& complete);
  void Put(BrickRun run, const TypedBrickPtr& brick);
  const TypedBrickPtr& ConstantBrick(float value);

  std::uint64_t max_voxels_;
  std::optional<VolumeLattice> lattice_;
  std::optional<VolumePlacement> placement_;
  BrickMap bricks_;
  TypedBrickPtr background_;
  static constexpr std::size_t kLeastConstants = 4096;
  std::unordered_map<std::uint32_t, TypedBrickPtr> constants_;  // by the bits of the value
  std::size_t most_constants_ = kLeastConstants;                // until they are looked through
  ContentHash hash_;  // of bricks_, less that of a volume of background
  std::optional<VolumeRevision> resume_;
  bool is_complete_ = false;
  ContentHash content_hash_;
  std::uint64_t bricks_left_ = 0;

  Vec3i overview_size_ = Vec3i::Zero();
  std::vector<float> overview_;
  std::uint64_t overview_known_ = 0;

  MirrorChanges changes_;
};

}  // namespace palpate::client
