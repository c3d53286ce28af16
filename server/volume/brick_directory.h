// The voxels of a volume: leaves of 8³ voxels (leaf.h) in blocks of 8³ leaves, each leaf with the
// volume revision at which it changed last.
//
// A directory never changes; a change makes a new one, which shares all that
// stayed: leaves, and blocks. So a change costs what it touches, any
// number of readers keep what they read, and "what changed since revision n" is
// answered without a history: from the revisions that the leaves carry. A block of one value
// throughout is one object wherever it stands: a sparse volume takes what its leaves take.
//
// Frame: I, voxel indices; brick (a, b, c) holds voxels 8a .. 8a + 7 along x and so
// on, voxel (i, j, k) of a brick at 64 i + 8 j + k. Voxels beyond the lattice are
// the background. Values in data units.
// Threads: any, at once. Real-time: Find and RevisionOf are wait-free and do not
// allocate; the rest is not for real-time code. Ownership: shared.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "common/bricks/brick.h"
#include "common/geometry/geometry.h"
#include "server/volume/leaf.h"

namespace palpate {

struct BrickChange {
  Vec3i brick;  // its coordinates
  LeafPtr values;
};

class BrickDirectory {
 public:
  // leaf(brick) for every brick, none null; all of them changed at revision 1. Asks block by block;
  // blocks with the smallest z come first.
  BrickDirectory(const Vec3i& size_voxels, const std::function<LeafPtr(const Vec3i& brick)>& leaf);

  // This directory with other leaves, which changed at `revision`; none twice.
  BrickDirectory With(std::span<const BrickChange> changes, std::uint64_t revision) const;

  // The same leaves, all of which changed at `revision`.
  BrickDirectory AllChangedAt(std::uint64_t revision) const;

  // What makes `this` to `other`, which has as many voxels: leaves that are
  // another object with other values. Blocks that both share cost nothing.
  std::vector<BrickChange> ChangesTo(const BrickDirectory& other) const;

  const Vec3i& brick_count() const { return brick_count_; }
  std::uint64_t NumberOf(const Vec3i& brick) const { return BrickNumber(brick, brick_count_); }
  Vec3i BrickOf(std::uint64_t number) const { return BrickWithNumber(number, brick_count_); }

  // The leaf that holds voxel (i, j, k), which is within the lattice.
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

  const ContentHash& content_hash() const { return hash_; }
  // What leaves and directory take of the heap, as if this directory alone held them. A constant
  // leaf counts once if the directory was made with it, and not at all if With() put it there.
  std::uint64_t MemoryBytes() const { return bytes_; }
  // The most that With() takes for changes in bricks min .. max, both included, beside their
  // leaves.
  static std::uint64_t BlockBytes(const Vec3i& min, const Vec3i& max);
  // The most that a volume of this size and type can take.
  static std::uint64_t MemoryBytes(const Vec3i& size_voxels, LeafType type = LeafType::kFloat);

 private:
  // 8³ leaves, in the order of voxels in a brick.
  struct BlockContents {
    std::array<LeafPtr, kBrickVoxels> leaves;  // none beyond the lattice, but in constant blocks
    std::array<std::uint64_t, kBrickVoxels> revisions{};
    std::uint64_t newest = 0;
    bool is_constant = false;  // and may stand at many places
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

  // All bricks of the blocks that are wanted, block by block.
  void ForEachBrickOfBlocks(const std::function<bool(std::size_t block)>& wanted,
                            const std::function<void(std::size_t block, std::size_t place,
                                                     const Vec3i& brick)>& visit) const;
  // Those of one block, and what they take.
  void Add(const Vec3i& block, const std::function<LeafPtr(const Vec3i& brick)>& leaf,
           class ConstantBlocks* constants);

  friend class ConstantBlocks;

  Vec3i brick_count_;
  Vec3i block_count_;
  std::vector<BlockPtr> blocks_;
  std::uint64_t least_revision_ = 1;  // of every leaf
  ContentHash hash_;
  std::uint64_t bytes_ = 0;
};

}  // namespace palpate
