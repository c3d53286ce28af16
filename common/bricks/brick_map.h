// The bricks of a volume at a client, by place: blocks of 8³ bricks. A block with one brick
// throughout takes the memory of a pointer, so a sparse volume takes only the memory of its bricks.
//
// Share() returns the present state, which never changes; it shares all blocks with the map. The
// map copies a shared block when it changes it.
//
// Frame: I, voxel indices; bricks are numbered as in brick.h. Threads: as a standard container; a
// shared state may be read on any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "common/bricks/typed_brick.h"

namespace palpate {

// The bricks first .. first + count - 1, by number.
struct BrickRun {
  std::uint64_t first = 0;
  std::uint64_t count = 0;
  std::uint64_t end() const { return first + count; }
  friend bool operator==(const BrickRun&, const BrickRun&) = default;
};

// Adds a run to others; extends the last one if the added one follows it.
void AddTo(std::vector<BrickRun>& runs, BrickRun added);
// Sorts runs and joins those that touch or overlap.
void Join(std::vector<BrickRun>& runs);

class BrickMap {
 public:
  BrickMap() = default;
  // The same brick, not null, at every place.
  BrickMap(const Vec3i& brick_count, TypedBrickPtr brick);
  BrickMap(BrickMap&&) = default;
  BrickMap& operator=(BrickMap&&) = default;

  const Vec3i& brick_count() const { return brick_count_; }
  std::uint64_t size() const { return brick_count_.cast<std::uint64_t>().prod(); }

  // The place must be within the map.
  const TypedBrickPtr& At(const Vec3i& brick) const {
    const Block& block = *blocks_[BlockOf(brick)];
    return block
        .bricks[block.bricks.size() == 1 ? 0 : VoxelInBrick(brick.x(), brick.y(), brick.z())];
  }
  const TypedBrickPtr& At(std::uint64_t number) const {
    return At(BrickWithNumber(number, brick_count_));
  }
  // A voxel within the lattice.
  float Value(int i, int j, int k) const {
    return (*At(Vec3i(i >> 3, j >> 3, k >> 3)))[VoxelInBrick(i, j, k)];
  }

  // Blocks of 8³ bricks. Block (a, b, c) begins at brick (8a, 8b, 8c).
  const Vec3i& block_count() const { return block_count_; }
  // The brick at all places of the block; null if it has several.
  const TypedBrickPtr& Only(const Vec3i& block) const;
  // The smallest type that holds all bricks.
  LeafType SmallestType() const;

  void Put(std::uint64_t number, const TypedBrickPtr& brick) { Fill({number, 1}, brick); }
  // The runs' bricks must be within the map.
  void Fill(BrickRun run, const TypedBrickPtr& brick);
  // Takes the bricks of another map of the same size.
  void CopyFrom(const BrickMap& other, BrickRun run);

  std::shared_ptr<const BrickMap> Share();

 private:
  struct Block {
    std::uint64_t epoch = 0;
    std::vector<TypedBrickPtr> bricks;  // one for all places, or 8³ in the order of voxels
  };
  using BlockPtr = std::shared_ptr<Block>;

  std::size_t BlockOf(const Vec3i& brick) const {
    return (static_cast<std::size_t>(brick.x() >> 3) * block_count_.y() + (brick.y() >> 3)) *
               block_count_.z() +
           (brick.z() >> 3);
  }
  // The block, for changes: no other map has it.
  Block& Own(std::size_t block);
  // Calls visit(brick, count) for the parts of a run that are rows of one block along z.
  void ForEachRow(BrickRun run, const std::function<void(const Vec3i&, int)>& visit) const;

  Vec3i brick_count_ = Vec3i::Zero();
  Vec3i block_count_ = Vec3i::Zero();
  std::vector<BlockPtr> blocks_;
  std::uint64_t epoch_ = 1;  // blocks of earlier epochs are shared
};

}  // namespace palpate
