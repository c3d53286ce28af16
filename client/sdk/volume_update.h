// What changed in the volume since it was asked for last.
//
// Frames: I voxel indices, W world, D device (mm); values in data units. Bricks hold
// 8³ voxels and never change once handed out: common/bricks/brick.h.
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/bricks/brick.h"
#include "common/bricks/volume_event.h"

namespace palpate::client {

struct ChangedBrick {
  std::uint64_t number = 0;
  BrickPtr brick;
};

struct VolumeUpdate {
  // Another volume begins: whatever is had of an earlier one is void, and every
  // brick that is not in `bricks` is the lattice's background.
  bool all = false;
  // None where the copy was void and no volume has begun since.
  std::optional<VolumeLattice> lattice;
  // None before it is known for this volume.
  std::optional<VolumePlacement> placement;
  // Means of blocks of 4³ voxels when the volume began, to show something while
  // bricks come; block (i, j, k) at (i size_y + j) size_z + k. In one update per
  // volume; empty in all others.
  Vec3i overview_size = Vec3i::Zero();
  std::vector<float> overview;
  std::vector<ChangedBrick> bricks;  // ascending
  // With these bricks the copy equals the daemon's volume of this revision, voxel by
  // voxel, which a hash has shown. None while bricks are still to come.
  std::optional<VolumeRevision> complete;
  std::uint64_t bricks_left = 0;  // still to come, as far as is known
};

// How the copy fares.
struct VolumeStatus {
  bool complete = false;
  std::uint64_t bricks_left = 0;
  std::uint64_t bytes_received = 0;  // as they travelled
  // Why it does not come; empty: nothing is wrong.
  std::string problem;
};

}  // namespace palpate::client
