#include "server/volume/snapshot/brick_directory.h"

#include <algorithm>
#include <cassert>
#include <map>
#include <memory>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "server/volume/snapshot/brick_memory.h"

namespace palpate {
namespace {

Vec3i CountOf(const Vec3i& size, int edge) { return ((size.array() + (edge - 1)) / edge).matrix(); }

// Calls visit(place, brick) for the bricks of a block that are within the lattice.
template <class Visit>
void ForEachBrick(const Vec3i& block, const Vec3i& brick_count, const Visit& visit) {
  const Vec3i first = block * 8;
  const Vec3i end = (first + Vec3i::Constant(8)).cwiseMin(brick_count);
  for (int a = first.x(); a < end.x(); ++a) {
    for (int b = first.y(); b < end.y(); ++b) {
      for (int c = first.z(); c < end.z(); ++c) visit(VoxelInBrick(a, b, c), Vec3i(a, b, c));
    }
  }
}

// The same, but neighbours along x come one after the other: where voxels lie in a row, they share
// cache lines.
template <class Visit>
void ForEachBrickInRows(const Vec3i& block, const Vec3i& brick_count, const Visit& visit) {
  const Vec3i first = block * 8;
  const Vec3i end = (first + Vec3i::Constant(8)).cwiseMin(brick_count);
  for (int c = first.z(); c < end.z(); ++c) {
    for (int b = first.y(); b < end.y(); ++b) {
      for (int a = first.x(); a < end.x(); ++a) visit(VoxelInBrick(a, b, c), Vec3i(a, b, c));
    }
  }
}

// Hashes leaves. Many leaves in a row may be the same object, so the last hash is kept.
class LeafHasher {
 public:
  ContentHash Of(const LeafPtr& leaf, std::uint64_t number) {
    if (leaf != last_) {
      last_ = leaf;
      leaf->CopyTo(floats_.data());
    }
    return HashOfBrick(floats_, number);
  }

 private:
  LeafPtr last_;
  Brick floats_;
};

std::uint64_t BytesAt(const Leaf& leaf) { return leaf.is_constant() ? 0 : leaf.Bytes(); }

}  // namespace

// Makes each block of one constant leaf only once.
class ConstantBlocks {
 public:
  // Counts the leaf once, however many blocks and places use it.
  bool IsNew(const LeafPtr& leaf) {
    if (leaf == last_) return false;
    last_ = leaf;
    return leaves_.insert(leaf.get()).second;
  }

  const BrickDirectory::BlockPtr& Of(const LeafPtr& leaf, bool* is_new) {
    BrickDirectory::BlockPtr& block = blocks_[leaf.get()];
    *is_new = !block;
    if (!block) {
      auto made = std::make_shared<BrickDirectory::Block>();
      made->leaves.fill(leaf);
      made->is_constant = true;
      block = std::move(made);
    }
    return block;
  }

 private:
  LeafPtr last_;
  std::unordered_set<const Leaf*> leaves_;
  std::unordered_map<const Leaf*, BrickDirectory::BlockPtr> blocks_;
};

BrickDirectory::Block::Block() { AddBrickBytes(sizeof(Block)); }

BrickDirectory::Block::Block(const Block& other) : BlockContents(other) {
  AddBrickBytes(sizeof(Block));
}

BrickDirectory::Block::~Block() { SubtractBrickBytes(sizeof(Block)); }

BrickDirectory::BrickDirectory(const Vec3i& size_voxels,
                               const std::function<LeafPtr(const Vec3i& brick)>& leaf)
    : brick_count_(CountOf(size_voxels, kBrickEdge)), block_count_(CountOf(brick_count_, 8)) {
  blocks_.resize(static_cast<std::size_t>(block_count_.cast<std::int64_t>().prod()));
  bytes_ = blocks_.size() * sizeof(BlockPtr);
  ConstantBlocks constants;
  Vec3i block;
  for (block.z() = 0; block.z() < block_count_.z(); ++block.z()) {
    for (block.y() = 0; block.y() < block_count_.y(); ++block.y()) {
      for (block.x() = 0; block.x() < block_count_.x(); ++block.x()) {
        Add(block, leaf, &constants);
      }
    }
  }
}

void BrickDirectory::Add(const Vec3i& block, const std::function<LeafPtr(const Vec3i& brick)>& leaf,
                         ConstantBlocks* constants) {
  auto made = std::make_shared<Block>();
  LeafHasher hasher;
  const LeafPtr* first = nullptr;
  bool is_constant = true;
  ForEachBrickInRows(block, brick_count_, [&](std::size_t place, const Vec3i& brick) {
    LeafPtr& at = made->leaves[place];
    at = leaf(brick);
    assert(at != nullptr);
    hash_ += hasher.Of(at, NumberOf(brick));
    made_type_ = CommonType(made_type_, at->type());
    bytes_ += BytesAt(*at);
    if (at->is_constant() && constants->IsNew(at)) bytes_ += at->Bytes();
    if (!first) first = &at;
    is_constant = is_constant && at->is_constant() && at == *first;
  });
  BlockPtr& slot = blocks_[BlockOf(block * 8)];
  bool is_new = true;
  if (is_constant) {
    slot = constants->Of(*first, &is_new);
  } else {
    slot = std::move(made);
  }
  if (is_new) bytes_ += sizeof(Block);
}

BrickDirectory BrickDirectory::With(std::span<const BrickChange> changes,
                                    std::uint64_t revision) const {
  BrickDirectory changed = *this;
  std::map<std::size_t, std::shared_ptr<Block>> copies;
  LeafHasher before, after;
  for (const BrickChange& change : changes) {
    const std::size_t place = PlaceInBlock(change.brick);
    std::shared_ptr<Block>& copy = copies[BlockOf(change.brick)];
    if (!copy) {
      copy = std::make_shared<Block>(*blocks_[BlockOf(change.brick)]);
      // The copy takes its own memory.
      if (std::exchange(copy->is_constant, false)) changed.bytes_ += sizeof(Block);
    }
    const std::uint64_t number = NumberOf(change.brick);
    LeafPtr& leaf = copy->leaves[place];
    changed.hash_ -= before.Of(leaf, number);
    changed.hash_ += after.Of(change.values, number);
    changed.bytes_ += BytesAt(*change.values) - BytesAt(*leaf);
    leaf = change.values;
    copy->revisions[place] = copy->newest = revision;
  }
  for (auto& [block, copy] : copies) changed.blocks_[block] = std::move(copy);
  return changed;
}

BrickDirectory BrickDirectory::AllChangedAt(std::uint64_t revision) const {
  BrickDirectory changed = *this;
  changed.least_revision_ = revision;
  // A recording's volume may have higher revisions than the session that shows it.
  for (BlockPtr& block : changed.blocks_) {
    if (block->newest <= revision) continue;
    auto copy = std::make_shared<Block>(*block);
    copy->revisions.fill(0);
    copy->newest = 0;
    block = std::move(copy);
  }
  return changed;
}

void BrickDirectory::ForEachBrickOfBlocks(
    const std::function<bool(std::size_t block)>& wanted,
    const std::function<void(std::size_t block, std::size_t place, const Vec3i& brick)>& visit)
    const {
  std::size_t n = 0;
  Vec3i block;
  for (block.x() = 0; block.x() < block_count_.x(); ++block.x()) {
    for (block.y() = 0; block.y() < block_count_.y(); ++block.y()) {
      for (block.z() = 0; block.z() < block_count_.z(); ++block.z(), ++n) {
        if (!wanted(n)) continue;
        ForEachBrick(block, brick_count_,
                     [&](std::size_t place, const Vec3i& brick) { visit(n, place, brick); });
      }
    }
  }
}

std::vector<BrickChange> BrickDirectory::ChangesTo(const BrickDirectory& other) const {
  assert(other.brick_count_ == brick_count_);
  std::vector<BrickChange> changes;
  ForEachBrickOfBlocks([&](std::size_t block) { return blocks_[block] != other.blocks_[block]; },
                       [&](std::size_t block, std::size_t place, const Vec3i& brick) {
                         const LeafPtr& from = blocks_[block]->leaves[place];
                         const LeafPtr& to = other.blocks_[block]->leaves[place];
                         if (from != to && !HaveSameValues(*from, *to)) {
                           changes.push_back({brick, to});
                         }
                       });
  return changes;
}

const LeafPtr& BrickDirectory::At(const Vec3i& brick) const {
  return blocks_[BlockOf(brick)]->leaves[PlaceInBlock(brick)];
}

std::vector<std::uint64_t> BrickDirectory::ChangedSince(std::uint64_t revision) const {
  std::vector<std::uint64_t> numbers;
  const bool all = least_revision_ > revision;
  ForEachBrickOfBlocks([&](std::size_t block) { return all || blocks_[block]->newest > revision; },
                       [&](std::size_t block, std::size_t place, const Vec3i& brick) {
                         if (all || blocks_[block]->revisions[place] > revision) {
                           numbers.push_back(NumberOf(brick));
                         }
                       });
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

std::uint64_t BrickDirectory::BlockBytes(const Vec3i& min, const Vec3i& max) {
  const Vec3i blocks = max / 8 - min / 8 + Vec3i::Ones();
  return static_cast<std::uint64_t>(blocks.cast<std::int64_t>().prod()) * sizeof(Block);
}

std::uint64_t BrickDirectory::MemoryBytes(const Vec3i& size_voxels, LeafType type) {
  const Vec3i bricks = CountOf(size_voxels, kBrickEdge);
  return static_cast<std::uint64_t>(bricks.cast<std::int64_t>().prod()) * Leaf::Bytes(type) +
         static_cast<std::uint64_t>(CountOf(bricks, 8).cast<std::int64_t>().prod()) *
             (sizeof(Block) + sizeof(BlockPtr));
}

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
