// A hash of the contents of a volume. A replay uses it to tell whether its volume is the recorded
// one.
//
// The hash covers size, spacing, value range and voxels: forces depend on nothing else of a volume,
// wherever it was loaded from. The voxels enter by their content hash, so hashing takes almost no
// time.
// Threads: any. Not for real-time code.
#pragma once

#include <compare>
#include <cstdint>

#include "server/volume/snapshot/snapshot.h"

namespace palpate {

struct VolumeHash {
  std::uint64_t high = 0;
  std::uint64_t low = 0;
  friend auto operator<=>(const VolumeHash&, const VolumeHash&) = default;
};

// The same on every machine and in every release: xxHash promises that XXH3 does not change. Gives
// no protection against forgery.
VolumeHash HashVolume(const VolumeSnapshot& volume);

}  // namespace palpate
