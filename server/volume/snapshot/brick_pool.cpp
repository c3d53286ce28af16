#include "server/volume/snapshot/brick_pool.h"

#include <algorithm>
#include <memory>
#include <unordered_set>
#include <utility>

namespace palpate {
namespace {

// Returns the leaf with the background beyond the lattice.
LeafPtr WithBackground(const LeafPtr& leaf, const Vec3i& voxels, float background) {
  Brick filled = leaf->Floats();
  for (int i = 0; i < kBrickEdge; ++i) {
    for (int j = 0; j < kBrickEdge; ++j) {
      for (int k = 0; k < kBrickEdge; ++k) {
        if (i >= voxels.x() || j >= voxels.y() || k >= voxels.z()) {
          filled[VoxelInBrick(i, j, k)] = background;
        }
      }
    }
  }
  return leaf->With(filled);
}

}  // namespace

LeafPtr BrickPool::Share(const LeafPtr& leaf) {
  const std::uint64_t hash = HashOfBrick(leaf->Floats(), 0).low;
  const auto [begin, end] = by_hash_.equal_range(hash);
  for (auto known = begin; known != end; ++known) {
    // Compares bits, not values: a content hash distinguishes -0 and 0.
    if (HaveSameBits(*known->second, *leaf)) return known->second;
  }
  by_hash_.emplace(hash, leaf);
  return leaf;
}

BrickDirectory BrickPool::Share(const BrickDirectory& bricks, const Vec3i& size_voxels,
                                float background) {
  return {size_voxels, [&](const Vec3i& brick) {
            const Vec3i voxels = size_voxels - brick * kBrickEdge;
            const bool is_whole = (voxels.array() >= kBrickEdge).all();
            return Share(is_whole ? bricks.At(brick)
                                  : WithBackground(bricks.At(brick), voxels, background));
          }};
}

std::uint64_t MemoryBytes(std::span<const BrickDirectory> directories, const Vec3i& size_voxels) {
  std::unordered_set<const Leaf*> leaves;
  std::uint64_t leaf_bytes = 0;
  for (const BrickDirectory& directory : directories) {
    const std::uint64_t count = directory.brick_count().cast<std::int64_t>().prod();
    for (std::uint64_t number = 0; number < count; ++number) {
      const LeafPtr& leaf = directory.At(directory.BrickOf(number));
      if (leaves.insert(leaf.get()).second) leaf_bytes += leaf->Bytes();
    }
  }
  // The most memory that the directories themselves take.
  const std::uint64_t places = static_cast<std::uint64_t>(
      directories.empty() ? 0 : directories[0].brick_count().cast<std::int64_t>().prod());
  const std::uint64_t each =
      BrickDirectory::MemoryBytes(size_voxels) - places * Leaf::Bytes(LeafType::kFloat);
  return directories.size() * each + leaf_bytes;
}

}  // namespace palpate
