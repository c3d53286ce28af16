// Leaves of the same values, kept once.
//
// Threads: one at a time. Ownership: the pool keeps what went into it until it is
// destroyed.
#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>

#include "server/volume/brick_directory.h"

namespace palpate {

class BrickPool {
 public:
  // The leaf of these values (the same bits, as floats) that came first: this one, or another.
  LeafPtr Share(const LeafPtr& leaf);

  // The same voxels out of shared leaves. Those of the last leaves along an axis that
  // lie beyond the lattice become `background`.
  BrickDirectory Share(const BrickDirectory& bricks, const Vec3i& size_voxels, float background);

 private:
  std::unordered_multimap<std::uint64_t, LeafPtr> by_hash_;
};

// Of all their leaves, shared ones counted once. All of them of this lattice.
std::uint64_t MemoryBytes(std::span<const BrickDirectory> directories, const Vec3i& size_voxels);

}  // namespace palpate
