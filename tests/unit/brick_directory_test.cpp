// The bricks of a volume: changes, revisions, hash, memory, and grids made of them.
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/openvdb_grids.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <optional>
#include <random>
#include <set>

#include "server/volume/snapshot/brick_memory.h"
#include "server/volume/snapshot/grid_tree.h"
#include "server/volume/snapshot/snapshot_builder.h"
#include "tests/support/made_volume.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

// Neither a multiple of a brick nor of a node along any axis but one.
const Vec3i kSize(130, 64, 21);

LeafPtr RandomBrick(std::mt19937& random) {
  Brick brick{};
  for (float& value : brick) value = std::uniform_real_distribution<float>(0, 1)(random);
  return Leaf::Of(LeafType::kFloat, brick);
}

BrickDirectory RandomDirectory(std::mt19937& random, const Vec3i& size = kSize) {
  return {size, [&](const Vec3i&) { return RandomBrick(random); }};
}

BrickDirectory Copied(const BrickDirectory& bricks, const Vec3i& size = kSize) {
  return {size, [&](const Vec3i& brick) {
            return Leaf::Of(LeafType::kFloat, bricks.At(brick)->Floats());
          }};
}

std::uint64_t CountOf(const BrickDirectory& bricks) {
  return static_cast<std::uint64_t>(bricks.brick_count().cast<std::int64_t>().prod());
}

std::vector<BrickChange> RandomChanges(const BrickDirectory& bricks, std::mt19937& random,
                                       int count) {
  std::set<std::uint64_t> numbers;
  while (count-- > 0) numbers.insert(random() % CountOf(bricks));
  std::vector<BrickChange> changes;
  for (const std::uint64_t number : numbers) {
    changes.push_back({bricks.BrickOf(number), RandomBrick(random)});
  }
  return changes;
}

TEST(BrickDirectoryTest, NumbersAndCoordinatesAreOneToOne) {
  std::mt19937 random(1);
  const BrickDirectory bricks = RandomDirectory(random);
  EXPECT_EQ(bricks.brick_count(), Vec3i(17, 8, 3));
  for (std::uint64_t n = 0; n < CountOf(bricks); ++n) {
    EXPECT_EQ(bricks.NumberOf(bricks.BrickOf(n)), n);
    EXPECT_EQ(bricks.RevisionOf(bricks.BrickOf(n)), 1u);
  }
}

// Against a plain map of bricks and revisions.
TEST(BrickDirectoryTest, RandomChangesAreSeenAndHashedAndOldCopiesStay) {
  std::mt19937 random(3);
  BrickDirectory bricks = RandomDirectory(random);
  std::map<std::uint64_t, std::pair<LeafPtr, std::uint64_t>> model;
  for (std::uint64_t n = 0; n < CountOf(bricks); ++n) model[n] = {bricks.At(bricks.BrickOf(n)), 1};
  const BrickDirectory first = bricks;
  for (std::uint64_t revision = 2; revision < 40; ++revision) {
    const BrickDirectory before = bricks;
    const BrickDirectory before_copy = Copied(before);
    const auto changes = RandomChanges(bricks, random, static_cast<int>(1 + random() % 60));
    bricks = before.With(changes, revision);
    for (const BrickChange& change : changes) {
      model[bricks.NumberOf(change.brick)] = {change.values, revision};
    }
    for (const auto& [number, expected] : model) {
      ASSERT_EQ(bricks.At(bricks.BrickOf(number)), expected.first);
      ASSERT_EQ(bricks.RevisionOf(bricks.BrickOf(number)), expected.second);
    }
    for (const std::uint64_t since : {std::uint64_t{0}, revision / 2, revision - 1, revision}) {
      std::vector<std::uint64_t> expected;
      for (const auto& [number, brick] : model) {
        if (brick.second > since) expected.push_back(number);
      }
      ASSERT_EQ(bricks.ChangedSince(since), expected);
    }
    // Differences are of values, not of objects.
    ASSERT_TRUE(before.ChangesTo(before_copy).empty());
    const auto found = before.ChangesTo(bricks);
    ASSERT_TRUE(std::equal(found.begin(), found.end(), changes.begin(), changes.end(),
                           [](const BrickChange& a, const BrickChange& b) {
                             return a.brick == b.brick && a.values == b.values;
                           }));
    ASSERT_EQ(before.content_hash(), before_copy.content_hash());
    ASSERT_EQ(bricks.content_hash(), Copied(bricks).content_hash());
    ASSERT_NE(bricks.content_hash(), before.content_hash());
  }
  // And back, by differences.
  bricks = bricks.With(bricks.ChangesTo(first), 40);
  EXPECT_EQ(bricks.content_hash(), first.content_hash());
  EXPECT_TRUE(bricks.ChangesTo(first).empty());
  EXPECT_EQ(bricks.With({}, 41).content_hash(), first.content_hash());
  EXPECT_TRUE(bricks.With({}, 41).ChangedSince(40).empty());
}

TEST(BrickDirectoryTest, TheHashSeesOneBitAndTheOrderOfBricks) {
  std::mt19937 random(5);
  const BrickDirectory bricks = RandomDirectory(random, Vec3i(16, 8, 8));
  Brick other = bricks.At(Vec3i(1, 0, 0))->Floats();
  other[511] = std::nextafter(other[511], 2.0f);
  const BrickDirectory one_bit =
      bricks.With(std::vector<BrickChange>{{Vec3i(1, 0, 0), Leaf::Of(LeafType::kFloat, other)}}, 2);
  EXPECT_NE(one_bit.content_hash(), bricks.content_hash());
  const BrickDirectory swapped =
      bricks.With(std::vector<BrickChange>{{Vec3i(0, 0, 0), bricks.At(Vec3i(1, 0, 0))},
                                           {Vec3i(1, 0, 0), bricks.At(Vec3i(0, 0, 0))}},
                  2);
  EXPECT_NE(swapped.content_hash(), bricks.content_hash());
}

// Also at an earlier revision, as of a recording, whose session saw more revisions than ours.
TEST(BrickDirectoryTest, AllChangedAtLeavesBricksAndHash) {
  std::mt19937 random(7);
  const BrickDirectory first = RandomDirectory(random);
  const BrickDirectory bricks = first.With(RandomChanges(first, random, 30), 50);
  for (const std::uint64_t revision : {9u, 60u}) {
    const BrickDirectory all = bricks.AllChangedAt(revision);
    EXPECT_EQ(all.content_hash(), bricks.content_hash());
    EXPECT_EQ(all.ChangedSince(revision - 1).size(), CountOf(bricks));
    EXPECT_TRUE(all.ChangedSince(revision).empty());
    EXPECT_EQ(all.RevisionOf(Vec3i::Zero()), revision);
  }
  EXPECT_TRUE(first.ChangedSince(1).empty());
}

TEST(BrickDirectoryTest, MemoryFollowsChangesAndTheirUndo) {
  const LeafPtr byte = Leaf::Constant(LeafType::kUint8, 3.0f);
  const BrickDirectory constant(kSize, [&](const Vec3i&) { return byte; });
  std::mt19937 random(14);
  const auto changes = RandomChanges(constant, random, 30);
  const BrickDirectory changed = constant.With(changes, 2);
  const std::uint64_t leaves = changes.size() * Leaf::Bytes(LeafType::kFloat);
  EXPECT_GT(changed.MemoryBytes(), constant.MemoryBytes() + leaves);
  EXPECT_LT(changed.MemoryBytes(), constant.MemoryBytes() + leaves + 20 * 10000);
  const BrickDirectory again = changed.With(changes, 3);
  EXPECT_EQ(again.MemoryBytes(), changed.MemoryBytes());
  // The blocks stay as they are.
  const BrickDirectory back = changed.With(changed.ChangesTo(constant), 4);
  EXPECT_EQ(back.MemoryBytes(), changed.MemoryBytes() - leaves);
}

TEST(BrickDirectoryTest, WhatLivesCountsOnceInHowManyDirectoriesItIs) {
  const std::uint64_t before = LiveBrickBytes();
  {
    std::mt19937 random(6);
    std::optional<BrickDirectory> first = RandomDirectory(random);
    const std::uint64_t all = LiveBrickBytes() - before;
    EXPECT_LE(all, first->MemoryBytes());
    EXPECT_GE(static_cast<double>(all), 0.99 * static_cast<double>(first->MemoryBytes()));
    const BrickDirectory same = *first;
    EXPECT_EQ(LiveBrickBytes(), before + all);
    const auto changes = RandomChanges(same, random, 3);
    const BrickDirectory changed = same.With(changes, 2);
    const Vec3i last = same.brick_count() - Vec3i::Ones();
    const std::uint64_t leaves = changes.size() * Leaf::Bytes(LeafType::kFloat);
    EXPECT_GT(LiveBrickBytes(), before + all + leaves);
    EXPECT_LE(LiveBrickBytes(),
              before + all + leaves + BrickDirectory::BlockBytes(Vec3i::Zero(), last));
    first.reset();
    EXPECT_GT(LiveBrickBytes(), before + all);
  }
  EXPECT_EQ(LiveBrickBytes(), before);
}

TEST(BrickDirectoryTest, MemoryIsThatOfTheVoxels) {
  std::mt19937 random(9);
  const Vec3i size(128, 128, 64);
  const BrickDirectory dense = RandomDirectory(random, size);
  const double voxel_bytes = 4.0 * size.cast<double>().prod();
  // A leaf of OpenVDB's has 64 bytes of states, and it and we have some of our own.
  EXPECT_LE(static_cast<double>(dense.MemoryBytes()), 1.10 * voxel_bytes);
  EXPECT_GE(static_cast<double>(dense.MemoryBytes()), voxel_bytes);
  const LeafPtr shared = Leaf::Constant(LeafType::kFloat, 0.5f);
  const BrickDirectory constant(size, [&](const Vec3i&) { return shared; });
  EXPECT_LE(static_cast<double>(constant.MemoryBytes()), 0.005 * voxel_bytes);
}

TEST(BrickDirectoryTest, AGridAndBackIsTheSame) {
  for (const int seed : {10, 11, 12}) {
    std::mt19937 random(static_cast<unsigned>(seed));
    // A third of the bricks is constant, at the background or above.
    std::map<int, int> kinds;
    const auto volume = testing::MakeVolume(Vec3i(37, 24, 19), [&](int i, int j, int k) {
      const auto [kind, is_new] = kinds.try_emplace((i / 8 * 8 + j / 8) * 8 + k / 8, 0);
      if (is_new) kind->second = static_cast<int>(random() % 4);
      if (kind->second == 0) return 0.0;
      if (kind->second == 1) return 0.25;
      return static_cast<double>(random() % 1000) / 1000.0;
    });
    const openvdb::FloatGrid::Ptr grid =
        MakeGrid<openvdb::FloatGrid>(LeavesOf(volume->bricks()), volume->metadata());
    const BrickDirectory back = TakeBricks(*grid, volume->size());
    testing::ForEachVoxel(volume->size(), [&](const Vec3i& p) {
      ASSERT_EQ(testing::ValueAt(back, p), testing::ValueAt(*volume, p));
    });
    EXPECT_EQ(back.content_hash(), volume->bricks().content_hash());
  }
}

}  // namespace
}  // namespace palpate
