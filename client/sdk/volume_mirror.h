// A copy of the daemon's volume, kept equal to it by what a stream says.
//
// At every `complete` the content hash of the copy is compared with the daemon's:
// a copy that claims to be complete is equal, voxel by voxel.
//
// Frames: I voxel indices, W world and D device frame (mm); values in data units.
// Threads: one at a time; bricks that were handed out stay as they are, on any
// thread. Errors: Error with kInvalidArgument for messages that make no sense,
// kTooLarge for a volume that is larger than allowed, kInternal for a copy that is
// not equal; the copy is void then, as after Reset.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/bricks/volume_event.h"

namespace palpate::client {

// What the copy's owner has to take up since it asked last.
struct MirrorChanges {
  bool all = false;                      // another volume: its lattice, and every brick
  std::vector<std::uint64_t> numbers{};  // of changed bricks, ascending; where not all
};

class VolumeMirror {
 public:
  static constexpr std::uint64_t kMaxVoxels = std::uint64_t{1} << 31;

  explicit VolumeMirror(std::uint64_t max_voxels = kMaxVoxels) : max_voxels_(max_voxels) {}

  void Apply(const VolumeEvent& event);
  // Forgets the copy.
  void Reset();

  // To resume from: of the last `complete`; none when all is needed. Voxels that
  // came since are of a newer revision, and will come again.
  const std::optional<VolumeRevision>& resume() const { return resume_; }
  // The copy is the volume of revision resume(), rather than on its way to a newer
  // one.
  bool is_complete() const { return is_complete_; }
  // Bricks that are still to come, as far as is known.
  std::uint64_t bricks_left() const { return bricks_left_; }

  // None before a volume began.
  const std::optional<VolumeLattice>& lattice() const { return lattice_; }
  // None before it is known for this volume.
  const std::optional<VolumePlacement>& placement() const { return placement_; }

  // With a lattice. (i, j, k) is within the lattice, number below its Bricks().
  float Value(int i, int j, int k) const;
  const BrickPtr& At(std::uint64_t number) const { return bricks_[number]; }
  // Means of blocks of 4³ voxels when the volume began; block (i, j, k) of
  // overview_size() at (i size_y + j) size_z + k. Empty until all of it has come.
  std::span<const float> overview() const;
  const Vec3i& overview_size() const { return overview_size_; }

  MirrorChanges TakeChanges();

 private:
  void Take(const VolumeLattice& lattice);
  void Take(const VolumePlacement& placement);
  void Take(const VolumeOverview& overview);
  void Take(const VolumeBricks& bricks);
  void Take(const VolumeComplete& complete);
  void Put(std::uint64_t number, std::span<const float> values);

  std::uint64_t max_voxels_;
  std::optional<VolumeLattice> lattice_;
  std::optional<VolumePlacement> placement_;
  std::vector<BrickPtr> bricks_;  // by number; the background is shared
  ContentHash hash_;              // of bricks_
  std::optional<VolumeRevision> resume_;
  bool is_complete_ = false;
  std::uint64_t bricks_left_ = 0;

  Vec3i overview_size_ = Vec3i::Zero();
  std::vector<float> overview_;
  std::uint64_t overview_known_ = 0;

  MirrorChanges changes_;
};

}  // namespace palpate::client
