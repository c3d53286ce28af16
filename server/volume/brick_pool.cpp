#include "server/volume/brick_pool.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <unordered_set>
#include <utility>

namespace palpate {
namespace {

// The brick with the background beyond the lattice; itself where that is so.
BrickPtr WithBackground(const BrickPtr& brick, const Vec3i& voxels, float background) {
  auto filled = std::make_shared<Brick>(*brick);
  for (int i = 0; i < kBrickEdge; ++i) {
    for (int j = 0; j < kBrickEdge; ++j) {
      for (int k = 0; k < kBrickEdge; ++k) {
        if (i >= voxels.x() || j >= voxels.y() || k >= voxels.z()) {
          (*filled)[VoxelInBrick(i, j, k)] = background;
        }
      }
    }
  }
  return filled;
}

}  // namespace

BrickPtr BrickPool::Share(const BrickPtr& brick) {
  const std::uint64_t hash = HashOfBrick(*brick, 0).low;
  const auto [begin, end] = by_hash_.equal_range(hash);
  for (auto known = begin; known != end; ++known) {
    // Bits rather than values: -0 is not 0 to a content hash.
    if (std::memcmp(known->second->data(), brick->data(), sizeof(Brick)) == 0) {
      return known->second;
    }
  }
  by_hash_.emplace(hash, brick);
  return brick;
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
  // What one brick more costs.
  const std::uint64_t brick_bytes =
      BrickDirectory::MemoryBytes(Vec3i(16, 8, 8)) - BrickDirectory::MemoryBytes(Vec3i(8, 8, 8));
  std::unordered_set<const Brick*> bricks;
  std::uint64_t places = 0;
  for (const BrickDirectory& directory : directories) {
    const std::uint64_t count = directory.brick_count().cast<std::int64_t>().prod();
    for (std::uint64_t number = 0; number < count; ++number) {
      bricks.insert(directory.At(directory.BrickOf(number)).get());
    }
    places += count;
  }
  return directories.size() * BrickDirectory::MemoryBytes(size_voxels) -
         (places - bricks.size()) * brick_bytes;
}

}  // namespace palpate
