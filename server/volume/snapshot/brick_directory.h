// The voxels of a volume: leaves of 8³ voxels (leaf.h) in blocks of 8³ leaves. Each leaf has the
// volume revision of its last change.
//
// A directory never changes. A change makes a new directory that shares all unchanged leaves and
// blocks with the old one. So a change costs only the leaves and blocks that it touches, and any
// number of readers keep the state that they read. The revisions of the leaves tell which leaves
// changed since revision n, without a history. A block with one value throughout is one object for
// all its places, so a sparse volume takes only the memory of its leaves.
//
// Frame: I, voxel indices. Brick (a, b, c) holds voxels 8a .. 8a + 7 along x, and likewise along y
// and z. Voxel (i, j, k) of a brick is at 64 i + 8 j + k. Voxels beyond the lattice are the
// background. Values in data units.
// Threads: any, at once. Real-time: Find and RevisionOf are wait-free and do not allocate; the rest
// is not for real-time code. Ownership: shared.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "common/bricks/brick.h"
#include "common/geometry/geometry.h"
#include "server/volume/snapshot/leaf.h"

namespace palpate {

struct BrickChange {
  Vec3i brick;  // the brick's coordinates
  LeafPtr values;
};

class BrickDirectory {
 public:
  // Makes a directory with leaf(brick), never null, for every brick. All leaves count as changed at
  // revision 1. Calls `leaf` block by block; blocks with the smallest z come first.
  BrickDirectory(const Vec3i& size_voxels, const std::function<LeafPtr(const Vec3i& brick)>& leaf);

  // Returns this directory with other leaves, changed at `revision`. No brick may occur twice.
  BrickDirectory With(std::span<const BrickChange> changes, std::uint64_t revision) const;

  // Returns the same leaves, all changed at `revision`.
  BrickDirectory AllChangedAt(std::uint64_t revision) const;

  // Returns the changes that turn `this` into `other`, which must have the same number of voxels:
  // leaves that are another object with other values. Shared blocks cost no time.
  std::vector<BrickChange> ChangesTo(const BrickDirectory& other) const;

  const Vec3i& brick_count() const { return brick_count_; }
  std::uint64_t NumberOf(const Vec3i& brick) const { return BrickNumber(brick, brick_count_); }
  Vec3i BrickOf(std::uint64_t number) const { return BrickWithNumber(number, brick_count_); }

  // The leaf that holds voxel (i, j, k). The voxel must be within the lattice.
  const Leaf& Find(int i, int j, int k) const noexcept {
    const std::size_t block =
        (static_cast<std::size_t>(i >> 6) * block_count_.y() + (j >> 6)) * block_count_.z() +
        (k >> 6);
    return *blocks_[block]->leaves[VoxelInBrick(i >> 3, j >> 3, k >> 3)];
  }
  const LeafPtr& At(const Vec3i& brick) const;
  std::uint64_t RevisionOf(const Vec3i& brick) const noexcept {
    return std::max(least_revision_, blocks_[BlockOf(brick)]->revisions[PlaceInBlock(brick)]);
  }

  // Numbers of the bricks that changed after `revision`, ascending.
  std::vector<std::uint64_t> ChangedSince(std::uint64_t revision) const;

  // The smallest type that holds the leaves that the directory was made with. Leaves that With()
  // puts there may have other types.
  LeafType made_type() const { return made_type_; }

  const ContentHash& content_hash() const { return hash_; }
  // Heap memory of the leaves and the directory, as if this directory alone held them. A constant
  // leaf counts once if the directory was made with it, and not at all if With() put it there.
  std::uint64_t MemoryBytes() const { return bytes_; }
  // The most memory that With() takes for changes in bricks min .. max, both included, without
  // their leaves.
  static std::uint64_t BlockBytes(const Vec3i& min, const Vec3i& max);
  // The most memory that a volume of this size and type can take.
  static std::uint64_t MemoryBytes(const Vec3i& size_voxels, LeafType type = LeafType::kFloat);

 private:
  // 8³ leaves, in the order of voxels in a brick.
  struct BlockContents {
    std::array<LeafPtr, kBrickVoxels> leaves;  // null beyond the lattice, except in constant blocks
    std::array<std::uint64_t, kBrickVoxels> revisions{};
    std::uint64_t newest = 0;
    bool is_constant = false;  // such a block may be used at many places
  };
  // Counts itself (brick_memory.h).
  struct Block : BlockContents {
    Block();
    Block(const Block& other);
    ~Block();
    Block& operator=(const Block&) = delete;
  };
  using BlockPtr = std::shared_ptr<const Block>;

  std::size_t BlockOf(const Vec3i& brick) const {
    return (static_cast<std::size_t>(brick.x() >> 3) * block_count_.y() + (brick.y() >> 3)) *
               block_count_.z() +
           (brick.z() >> 3);
  }
  static std::size_t PlaceInBlock(const Vec3i& brick) {
    return VoxelInBrick(brick.x(), brick.y(), brick.z());
  }

  // Visits all bricks of the wanted blocks, block by block.
  void ForEachBrickOfBlocks(const std::function<bool(std::size_t block)>& wanted,
                            const std::function<void(std::size_t block, std::size_t place,
                                                     const Vec3i& brick)>& visit) const;
  // Adds the leaves of one block, and their memory.
  void Add(const Vec3i& block, const std::function<LeafPtr(const Vec3i& brick)>& leaf,
           class ConstantBlocks* constants);

  friend class ConstantBlocks;

  Vec3i brick_count_;
  Vec3i block_count_;
  std::vector<BlockPtr> blocks_;
  std::uint64_t least_revision_ = 1;  // no leaf's revision is lower
  LeafType made_type_ = LeafType::kUint8;
  ContentHash hash_;
  std::uint64_t bytes_ = 0;
};

// Keeps leaves with equal values once.
//
// Threads: one at a time. Ownership: the pool keeps its leaves until it is destroyed.
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
