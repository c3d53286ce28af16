// A name for the contents of a volume, so that a replay can tell whether it has
// the volume that was recorded.
//
// Of size, spacing, value range and voxels: what is felt depends on nothing else
// of a volume, wherever it was loaded from. The voxels come in by their content
// hash, so that this costs nothing.
// Threads: any. Not for real-time code.
#pragma once

#include <cstdint>

#include "server/volume/snapshot.h"

namespace palpate {

struct VolumeHash {
  std::uint64_t high = 0;
  std::uint64_t low = 0;
  friend bool operator==(const VolumeHash&, const VolumeHash&) = default;
};

// The same on every machine and in every release: xxHash promises that its XXH3
// does not change. No proof against forgery.
VolumeHash HashVolume(const VolumeSnapshot& volume);

}  // namespace palpate
