// Keeps leaves with equal values once.
//
// Threads: one at a time. Ownership: the pool keeps its leaves until it is destroyed.
#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>

#include "server/volume/snapshot/brick_directory.h"

namespace palpate {

class BrickPool {
 public:
  // Returns the first leaf with the same values (the same bits, as floats): this leaf or an earlier
  // one.
  LeafPtr Share(const LeafPtr& leaf);

  // Returns the same voxels, made of shared leaves. In the last leaves along an axis, voxels beyond
  // the lattice become `background`.
  BrickDirectory Share(const BrickDirectory& bricks, const Vec3i& size_voxels, float background);

 private:
  std::unordered_multimap<std::uint64_t, LeafPtr> by_hash_;
};

// Memory of all their leaves; shared leaves count once. All directories must be of this lattice.
std::uint64_t MemoryBytes(std::span<const BrickDirectory> directories, const Vec3i& size_voxels);

}  // namespace palpate
