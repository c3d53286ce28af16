// Leaves: every type's values and limits, copies, states, and what they take of the heap.
#include "server/volume/snapshot/leaf.h"
#include "server/volume/snapshot/openvdb_grids.h"

#include <gtest/gtest.h>
#include <malloc.h>

#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "server/volume/load/dense_bricks.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/brick_memory.h"
#include "tests/support/made_volume.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

Brick Counted(float first, float step) {
  Brick values;
  for (int n = 0; n < kBrickVoxels; ++n) values[n] = first + step * static_cast<float>(n);
  return values;
}

Brick Bytes() {
  Brick values;
  for (int n = 0; n < kBrickVoxels; ++n) values[n] = static_cast<float>(n % 256);
  return values;
}

TEST(Leaf, HoldsTheValuesOfEachType) {
  for (const auto& [type, values] :
       {std::pair(LeafType::kUint8, Bytes()), std::pair(LeafType::kInt16, Counted(-300.0f, 1.0f)),
        std::pair(LeafType::kUint16, Counted(65024.0f, 1.0f)),
        std::pair(LeafType::kFloat, Counted(-0.5f, 0.125f))}) {
    const LeafPtr leaf = Leaf::Of(type, values);
    EXPECT_EQ(leaf->type(), type);
    EXPECT_EQ(leaf->Floats(), values);
    EXPECT_EQ(Leaf::Smallest(values)->type(), type);
    for (std::size_t n = 0; n < values.size(); ++n) EXPECT_EQ((*leaf)[n], values[n]);
    EXPECT_FALSE(leaf->is_constant());
    EXPECT_TRUE(leaf->IsActive(0));
  }
}

TEST(Leaf, CountsOnceWhoeverHoldsIt) {
  const std::uint64_t before = LiveBrickBytes();
  {
    const LeafPtr leaf = Leaf::Of(LeafType::kInt16, Bytes());
    const LeafPtr same = leaf;
    EXPECT_EQ(LiveBrickBytes(), before + Leaf::Bytes(LeafType::kInt16));
    const LeafPtr other = leaf->With(Counted(0.5f, 1.0f));
    const LeafPtr constant = Leaf::Constant(LeafType::kUint8, 7.0f);
    EXPECT_EQ(LiveBrickBytes(), before + leaf->Bytes() + Leaf::Bytes(LeafType::kFloat) +
                                    Leaf::Bytes(LeafType::kUint8));
  }
  EXPECT_EQ(LiveBrickBytes(), before);
}

// The limits of each type, beside them, and what looks like an integer and is none.
TEST(LeafType, HoldsExactlyItsOwnValues) {
  struct Row {
    float value;
    bool uint8, int16, uint16;
  };
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (const Row& row :
       {Row{0.0f, true, true, true}, Row{-0.0f, false, false, false}, Row{1.0f, true, true, true},
        Row{255.0f, true, true, true}, Row{256.0f, false, true, true},
        Row{-1.0f, false, true, false}, Row{32767.0f, false, true, true},
        Row{32768.0f, false, false, true}, Row{-32768.0f, false, true, false},
        Row{-32769.0f, false, false, false}, Row{65535.0f, false, false, true},
        Row{65536.0f, false, false, false}, Row{0.5f, false, false, false},
        Row{254.99998f, false, false, false}, Row{NAN, false, false, false},
        Row{kInf, false, false, false}, Row{1e-40f, false, false, false}}) {
    EXPECT_EQ(Holds(LeafType::kUint8, row.value), row.uint8) << row.value;
    EXPECT_EQ(Holds(LeafType::kInt16, row.value), row.int16) << row.value;
    EXPECT_EQ(Holds(LeafType::kUint16, row.value), row.uint16) << row.value;
    EXPECT_TRUE(Holds(LeafType::kFloat, row.value)) << row.value;
  }
  for (const LeafType type : kLeafTypes) EXPECT_EQ(LeafTypeNamed(Name(type)), type);
  EXPECT_FALSE(LeafTypeNamed("int32"));
}

TEST(Leaf, OtherValuesStayInItsTypeOrBecomeFloats) {
  const LeafPtr leaf = Leaf::Of(LeafType::kUint8, Counted(7.0f, 0.0f));
  Brick values = leaf->Floats();
  values[5] = 255.0f;
  EXPECT_EQ(leaf->With(values)->type(), LeafType::kUint8);
  EXPECT_EQ(leaf->With(values)->Floats(), values);
  // Not the next larger type: the next edit would turn it again.
  values[5] = 256.0f;
  EXPECT_EQ(leaf->With(values)->type(), LeafType::kFloat);
  values[6] = 7.25f;
  EXPECT_EQ(leaf->With(values)->Floats(), values);
  EXPECT_EQ((*leaf)[5], 7.0f) << "what is published never changes";
}

TEST(Leaf, WhatAnEditTouchesIsActive) {
  auto node = std::make_unique<Leaf::Node<std::int16_t>>(openvdb::Coord(0, 0, 0), 3, false);
  node->setValueOn(9, 4);
  const LeafPtr leaf = Leaf::Take(std::move(node));
  Brick values = leaf->Floats();
  values[1] = 8.0f;
  const LeafPtr edited = leaf->With(values);
  for (std::size_t n = 0; n < kBrickVoxels; ++n) {
    EXPECT_EQ(leaf->IsActive(n), n == 9);
    EXPECT_EQ(edited->IsActive(n), n == 9 || n == 1);
  }
}

TEST(Leaf, IsTakenWithoutACopy) {
  auto node = std::make_unique<Leaf::Node<std::uint16_t>>(openvdb::Coord(0, 0, 0), 3, true);
  const std::uint16_t* const values = node->buffer().data();
  EXPECT_EQ(Leaf::Take(std::move(node))->values<std::uint16_t>(), values);
}

TEST(Leaf, ComparesValuesAndBits) {
  const LeafPtr zero = Leaf::Of(LeafType::kFloat, Counted(0.0f, 0.0f));
  const LeafPtr minus = testing::FilledLeaf(-0.0f);
  const LeafPtr byte = Leaf::Of(LeafType::kUint8, Counted(0.0f, 0.0f));
  EXPECT_TRUE(HaveSameValues(*zero, *minus));
  EXPECT_FALSE(HaveSameBits(*zero, *minus));
  EXPECT_TRUE(HaveSameBits(*zero, *byte));
}

#ifndef PALPATE_SANITIZED
// Against what malloc says, with its own count of the heap in use.
TEST(Leaf, TakesWhatItSays) {
  for (const LeafType type : kLeafTypes) {
    constexpr std::size_t kCount = 20000;
    std::vector<LeafPtr> leaves;
    leaves.reserve(kCount);
    const std::size_t before = mallinfo2().uordblks;
    for (std::size_t n = 0; n < kCount; ++n) {
      leaves.push_back(Leaf::Of(type, Counted(static_cast<float>(n % 200), 0.0f)));
    }
    const double taken = static_cast<double>(mallinfo2().uordblks - before) / kCount;
    EXPECT_NEAR(taken, static_cast<double>(Leaf::Bytes(type)), 16.0) << Name(type);
  }
}
#endif

// Out of voxels that lie in memory.
template <class T>
BrickDirectory BricksOf(const Vec3i& size, const std::vector<T>& voxels, float background) {
  const auto read = [&](int z, int first_y, int end_y, void* rows) {
    const auto row = [&](int y) {
      return voxels.begin() + (static_cast<std::ptrdiff_t>(z) * size.y() + y) * size.x();
    };
    std::copy(row(first_y), row(end_y), static_cast<T*>(rows));
  };
  return MakeBricks(size, kLeafTypeOf<T>, read, background);
}

// Every voxel, of sizes that cut bricks and blocks off, for each type.
TEST(MakeBricks, HasTheVoxelsOfARow) {
  const Vec3i size(70, 75, 131);
  const auto value = [](int i, int j, int k) { return (i * 7 + j * 31 + k / 16 * 5) % 200; };
  for (const LeafType type : kLeafTypes) {
    VisitType(type, [&](auto voxel) {
      std::vector<decltype(voxel)> voxels;
      // x runs fastest.
      testing::ForEachVoxel({size.z(), size.y(), size.x()}, [&](const Vec3i& p) {
        voxels.push_back(static_cast<decltype(voxel)>(value(p.z(), p.y(), p.x())));
      });
      const BrickDirectory bricks = BricksOf(size, voxels, 3.0f);
      testing::ForEachVoxel(size, [&](const Vec3i& p) {
        const int expected = value(p.x(), p.y(), p.z());
        const Leaf& leaf = bricks.Find(p.x(), p.y(), p.z());
        const std::size_t n = VoxelInBrick(p.x(), p.y(), p.z());
        ASSERT_EQ(leaf.type(), type);
        ASSERT_EQ(leaf[n], static_cast<float>(expected));
        ASSERT_EQ(leaf.IsActive(n), expected != 3);
      });
      EXPECT_EQ(bricks.Find(69, 74, 130)[VoxelInBrick(6, 74, 130)], 3.0f) << "beyond the lattice";
    });
  }
}

TEST(MakeBricks, ConstantRegionsCostNothing) {
  const Vec3i size(512, 256, 256);
  std::vector<std::uint8_t> voxels(static_cast<std::size_t>(size.prod()), 5);
  voxels[123456] = 6;
  const BrickDirectory bricks = BricksOf(size, voxels, 5.0f);
  EXPECT_LT(bricks.MemoryBytes(), 40000u);
  EXPECT_EQ(&bricks.Find(0, 200, 200), &bricks.Find(511, 100, 0));
}

// As OpenVDB makes a tree of dense voxels: what equals the background is the background.
TEST(MakeBricks, ZerosHaveTheBackgroundsSign) {
  std::vector<float> voxels(16 * 8 * 8, 0.0f);
  for (std::size_t n = 0; n < voxels.size(); n += 16) {
    for (std::size_t i = 8; i < 16; ++i) voxels[n + i] = -0.0f;
  }
  const Vec3i size(16, 8, 8);
  EXPECT_FALSE(std::signbit(BricksOf(size, voxels, 0.0f).Find(8, 0, 0)[0]));
  EXPECT_TRUE(std::signbit(BricksOf(size, voxels, -0.0f).Find(0, 0, 0)[0]));
  // Above another background they stay as they are.
  EXPECT_FALSE(std::signbit(BricksOf(size, voxels, -1.0f).Find(0, 0, 0)[0]));
  EXPECT_TRUE(std::signbit(BricksOf(size, voxels, -1.0f).Find(8, 0, 0)[0]));
}

TEST(BrickPool, KeepsEveryBitPatternOnce) {
  using testing::FilledLeaf;
  BrickPool pool;
  const LeafPtr zero = pool.Share(FilledLeaf(0.0f));
  EXPECT_EQ(pool.Share(FilledLeaf(0.0f)), zero);
  EXPECT_NE(pool.Share(FilledLeaf(-0.0f)), zero);
  EXPECT_NE(pool.Share(FilledLeaf(1.0f)), zero);
  const LeafPtr nan = pool.Share(FilledLeaf(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_EQ(pool.Share(FilledLeaf(std::numeric_limits<float>::quiet_NaN())), nan);
}

TEST(BrickPool, CountsTheMemoryOfSharedBricksOnce) {
  const Vec3i size(32, 8, 8);
  const auto directory = [&](float first) {
    return BrickDirectory(size, [&](const Vec3i& brick) {
      return testing::FilledLeaf(static_cast<float>(brick.x()) + (brick.x() == 0 ? first : 0.0f));
    });
  };
  BrickPool pool;
  const std::vector<BrickDirectory> shared = {pool.Share(directory(10.0f), size, 0.0f),
                                              pool.Share(directory(20.0f), size, 0.0f)};
  EXPECT_EQ(MemoryBytes(shared, size),
            2 * BrickDirectory::MemoryBytes(size) - 3 * Leaf::Bytes(LeafType::kFloat));
  EXPECT_EQ(shared[0].ChangesTo(shared[1]).size(), 1u);
  EXPECT_EQ(MemoryBytes(std::vector{directory(1.0f), directory(1.0f)}, size),
            2 * BrickDirectory::MemoryBytes(size));
  EXPECT_EQ(shared[0].MemoryBytes(), BrickDirectory::MemoryBytes(size));
}

}  // namespace
}  // namespace palpate
