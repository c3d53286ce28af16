// The changes of the volume since the last update.
//
// Frames: I voxel indices, W world, D device (mm); values in data units. Bricks hold 8³ voxels in
// the volume's own type: common/bricks/typed_brick.h.
// Threads: plain values. `bricks` never changes; read it on any thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/bricks/brick_map.h"
#include "common/bricks/volume_event.h"

namespace palpate::client {

struct VolumeUpdate {
  // Another volume begins. Everything known of the earlier volume is void. Every brick that is not
  // in `changed` is the lattice's background.
  bool all = false;
  // None if the copy was void and no volume has begun since.
  std::optional<VolumeLattice> lattice;
  // None before the placement of this volume is known.
  std::optional<VolumePlacement> placement;
  // Means of blocks of 4³ voxels from when the volume began, for a first picture while bricks come.
  // Block (i, j, k) is at (i size_y + j) size_z + k. One update per volume has the overview; it is
  // empty in all others, and for volumes of more than 2^28 voxels.
  Vec3i overview_size = Vec3i::Zero();
  std::vector<float> overview;
  // All bricks as of this update; those that have not come are background. Null without a lattice.
  std::shared_ptr<const BrickMap> bricks;
  std::vector<BrickRun> changed;  // ascending, apart from each other
  // With these bricks the copy equals the daemon's volume of this revision, voxel by voxel; a hash
  // has confirmed this. None while bricks are still to come.
  std::optional<VolumeRevision> complete;
  ContentHash content_hash;       // of the complete volume, as the daemon has it
  std::uint64_t bricks_left = 0;  // still to come, as far as is known
};

// The state of the copy.
struct VolumeStatus {
  bool complete = false;
  std::uint64_t bricks_left = 0;
  std::uint64_t bytes_received = 0;  // as transferred
  // Why no voxels come; empty: nothing is wrong.
  std::string problem;
  bool is_loading = false;  // palpated loads its first volume; `problem` says how far it is
};

}  // namespace palpate::client
