#include "common/bricks/brick_map.h"

#include <algorithm>
#include <utility>

namespace palpate {

void AddTo(std::vector<BrickRun>& runs, BrickRun added) {
  if (!runs.empty() && runs.back().end() == added.first) {
    runs.back().count += added.count;
  } else {
    runs.push_back(added);
  }
}

void Join(std::vector<BrickRun>& runs) {
  std::sort(runs.begin(), runs.end(),
            [](const BrickRun& a, const BrickRun& b) { return a.first < b.first; });
  std::vector<BrickRun> joined;
  for (const BrickRun& run : runs) {
    if (!joined.empty() && run.first <= joined.back().end()) {
      joined.back().count = std::max(joined.back().end(), run.end()) - joined.back().first;
    } else {
      joined.push_back(run);
    }
  }
  runs = std::move(joined);
}

BrickMap::BrickMap(const Vec3i& brick_count, TypedBrickPtr brick)
    : brick_count_(brick_count),
      block_count_(BrickCount(brick_count.x()), BrickCount(brick_count.y()),
                   BrickCount(brick_count.z())) {
  // Of no epoch: all places share the block.
  const auto block = std::make_shared<Block>();
  block->bricks.push_back(std::move(brick));
  blocks_.assign(block_count_.cast<std::size_t>().prod(), block);
}

const TypedBrickPtr& BrickMap::Only(const Vec3i& block) const {
  static const TypedBrickPtr kNone;
  const Block& held = *blocks_[BlockOf(block * 8)];
  return held.bricks.size() == 1 ? held.bricks.front() : kNone;
}

LeafType BrickMap::SmallestType() const {
  LeafType type = LeafType::kUint8;
  ForEachRow({0, size()}, [&](const Vec3i& first, int count) {
    const Block& block = *blocks_[BlockOf(first)];
    if (block.bricks.size() == 1) count = 1;
    for (int n = 0; n < count; ++n) type = CommonType(type, At(first + Vec3i(0, 0, n))->type());
  });
  return type;
}

BrickMap::Block& BrickMap::Own(std::size_t block) {
  BlockPtr& held = blocks_[block];
  if (held->epoch != epoch_) {
    held = std::make_shared<Block>(*held);
    held->epoch = epoch_;
  }
  return *held;
}

void BrickMap::ForEachRow(BrickRun run, const std::function<void(const Vec3i&, int)>& visit) const {
  while (run.count > 0) {
    const Vec3i brick = BrickWithNumber(run.first, brick_count_);
    const int end = std::min((brick.z() & ~7) + 8, brick_count_.z());
    const auto count =
        std::min<std::uint64_t>(run.count, static_cast<std::uint64_t>(end - brick.z()));
    visit(brick, static_cast<int>(count));
    run.first += count;
    run.count -= count;
  }
}

void BrickMap::Fill(BrickRun run, const TypedBrickPtr& brick) {
  ForEachRow(run, [&](const Vec3i& first, int count) {
    const std::size_t at = BlockOf(first);
    if (blocks_[at]->bricks.size() == 1 && blocks_[at]->bricks.front() == brick) return;
    Block& block = Own(at);
    if (block.bricks.size() == 1) block.bricks.resize(kBrickVoxels, block.bricks.front());
    const std::size_t place = VoxelInBrick(first.x(), first.y(), first.z());
    std::fill_n(block.bricks.begin() + static_cast<std::ptrdiff_t>(place), count, brick);
    // Places beyond the lattice count, too: such blocks are few.
    if (!brick->is_constant()) return;
    const auto is_same = [&](const TypedBrickPtr& other) { return other == brick; };
    if (!std::all_of(block.bricks.begin(), block.bricks.end(), is_same)) return;
    block.bricks = std::vector<TypedBrickPtr>(1, brick);  // without the memory of 8³
  });
}

void BrickMap::CopyFrom(const BrickMap& other, BrickRun run) {
  ForEachRow(run, [&](const Vec3i& first, int count) {
    const std::uint64_t number = BrickNumber(first, brick_count_);
    for (int n = 0; n < count;) {
      const TypedBrickPtr& brick = other.At(first + Vec3i(0, 0, n));
      const int begin = n;
      while (n < count && other.At(first + Vec3i(0, 0, n)) == brick) ++n;
      Fill({number + static_cast<std::uint64_t>(begin), static_cast<std::uint64_t>(n - begin)},
           brick);
    }
  });
}

std::shared_ptr<const BrickMap> BrickMap::Share() {
  auto shared = std::make_shared<BrickMap>();
  shared->brick_count_ = brick_count_;
  shared->block_count_ = block_count_;
  shared->blocks_ = blocks_;
  ++epoch_;
  return shared;
}

}  // namespace palpate
