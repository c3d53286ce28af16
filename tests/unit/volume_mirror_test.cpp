// The copy of a client: messages that make no sense, damage, what changed.
#include <gtest/gtest.h>
#include <malloc.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <thread>
#include <vector>

#include "client/sdk/volume_copy.h"
#include "client/sdk/volume_mirror.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"
#include "tests/support/refusal.h"

namespace palpate::client {
namespace {

using testing::Refusal;

// 2 x 1 x 3 bricks.
VolumeLattice Lattice() {
  VolumeLattice lattice;
  lattice.source = "test";
  lattice.size = Vec3i(10, 8, 17);
  lattice.value_min = -5.0;
  lattice.value_max = 10.0;
  lattice.loaded_revision = 3;
  return lattice;
}

template <class T = float>
VolumeBricks Bricks(std::vector<std::uint64_t> numbers, T value = 1) {
  const std::vector<T> values(numbers.size() * kBrickVoxels, value);
  return {.type = kLeafTypeOf<T>,
          .numbers = std::move(numbers),
          .zstd_values = Compress(std::span<const T>(values)),
          .tiles = {}};
}

VolumeBricks Tiles(std::vector<VolumeTile> tiles) {
  VolumeBricks bricks;
  bricks.tiles = std::move(tiles);
  return bricks;
}

VolumeOverview Overview(std::uint64_t first, std::size_t count) {
  return {Vec3i(3, 2, 5), first, Compress(std::span<const float>(std::vector<float>(count, 0.5f)))};
}

ContentHash HashOf(float value, std::uint64_t number) {
  Brick brick;
  brick.fill(value);
  return HashOfBrick(brick, number);
}

// Of bricks that are constant; the background is -5.
VolumeComplete Complete(const std::vector<float>& values, std::uint64_t revision = 4) {
  VolumeComplete complete{{9, revision}, {}, {}};
  for (std::size_t n = 0; n < values.size(); ++n) {
    complete.content_hash += HashOf(values[n], n);
    complete.background_hash += HashOf(-5.0f, n);
  }
  return complete;
}

VolumeMirror Begun() {
  VolumeMirror mirror;
  mirror.Apply(Lattice());
  return mirror;
}

// Refused, and the copy is void afterwards.
void ExpectRefused(VolumeMirror mirror, const VolumeEvent& event,
                   ErrorKind kind = ErrorKind::kInvalidArgument) {
  EXPECT_EQ(Refusal([&] { mirror.Apply(event); }), kind);
  EXPECT_FALSE(mirror.lattice());
  EXPECT_FALSE(mirror.resume());
  EXPECT_FALSE(mirror.is_complete());
  EXPECT_TRUE(mirror.TakeChanges().all);
}

TEST(VolumeMirror, BecomesTheVolumeThatItIsToldOf) {
  VolumeMirror mirror = Begun();
  EXPECT_FALSE(mirror.is_complete());
  EXPECT_EQ(mirror.bricks().Value(9, 7, 16), -5.0f);
  mirror.Apply(Bricks({1, 5}, 2.0f));
  mirror.Apply(Complete({-5, 2, -5, -5, -5, 2}));
  EXPECT_TRUE(mirror.is_complete());
  EXPECT_EQ(*mirror.resume(), (VolumeRevision{9, 4}));
  EXPECT_EQ(mirror.bricks().Value(0, 0, 8), 2.0f);
  EXPECT_EQ(mirror.bricks().Value(7, 7, 7), -5.0f);
  EXPECT_EQ(mirror.bricks().Value(8, 0, 16), 2.0f);
  // On the way to the next revision the last one is what can be resumed from.
  mirror.Apply(Bricks({0}, 7.0f));
  EXPECT_FALSE(mirror.is_complete());
  EXPECT_EQ(*mirror.resume(), (VolumeRevision{9, 4}));
  mirror.Apply(Complete({7, 2, -5, -5, -5, 2}, 6));
  EXPECT_EQ(*mirror.resume(), (VolumeRevision{9, 6}));
}

TEST(VolumeMirror, SaysWhatChanged) {
  VolumeMirror mirror = Begun();
  EXPECT_TRUE(mirror.TakeChanges().all);
  EXPECT_TRUE(mirror.TakeChanges().bricks.empty());
  mirror.Apply(Bricks({3, 4}));
  mirror.Apply(Bricks({0, 4}));
  const MirrorChanges changes = mirror.TakeChanges();
  EXPECT_FALSE(changes.all);
  EXPECT_EQ(changes.bricks, (std::vector<BrickRun>{{0, 1}, {3, 2}}));
  mirror.Apply(Bricks({3}));
  mirror.Apply(Lattice());
  mirror.Apply(Bricks({2}));
  const MirrorChanges anew = mirror.TakeChanges();
  EXPECT_TRUE(anew.all);
  EXPECT_EQ(anew.bricks, (std::vector<BrickRun>{{2, 1}}));
}

TEST(VolumeMirror, HoldsEveryTypeAsItCame) {
  VolumeLattice lattice = Lattice();
  lattice.type = LeafType::kInt16;
  VolumeMirror mirror;
  mirror.Apply(lattice);
  mirror.Apply(Bricks<std::int16_t>({0}, -32768));
  mirror.Apply(Bricks<std::uint8_t>({1}, 255));
  mirror.Apply(Bricks<std::uint16_t>({2}, 65535));
  mirror.Apply(Bricks<float>({3}, 0.1f));
  mirror.Apply(Tiles({{{4, 1}, 7.0f}, {{5, 1}, 0.25f}}));
  const LeafType types[] = {LeafType::kInt16, LeafType::kUint8, LeafType::kUint16,
                            LeafType::kFloat, LeafType::kInt16, LeafType::kFloat};
  const std::vector<float> values{-32768.0f, 255.0f, 65535.0f, 0.1f, 7.0f, 0.25f};
  for (std::uint64_t n = 0; n < values.size(); ++n) {
    const TypedBrick& brick = *mirror.bricks().At(n);
    EXPECT_EQ(brick.type(), types[n]) << n;
    EXPECT_EQ(brick.is_constant(), n >= 4) << n;
    for (std::size_t voxel = 0; voxel < kBrickVoxels; ++voxel) ASSERT_EQ(brick[voxel], values[n]);
  }
  // The hash does not depend on the types.
  mirror.Apply(Complete(values));
  EXPECT_TRUE(mirror.is_complete());
}

TEST(VolumeMirror, ATileReplacesBricksAndBricksATile) {
  VolumeMirror mirror = Begun();
  mirror.Apply(Bricks({1, 2}, 2.0f));
  mirror.Apply(Tiles({{{0, 5}, 3.0f}}));
  mirror.Apply(Bricks({4}, 4.0f));
  mirror.Apply(Complete({3, 3, 3, 3, 4, -5}));
  mirror.Apply(Tiles({{{2, 3}, -5.0f}}));
  mirror.Apply(Complete({3, 3, -5, -5, -5, -5}));
}

// What a lattice takes that is nearly all background or one tile: 2^36 voxels in 2^27 bricks.
TEST(VolumeMirror, ALatticeTakesTheMemoryOfItsBricks) {
  VolumeLattice lattice = Lattice();
  lattice.size = Vec3i::Constant(4096);
  VolumeMirror mirror;
  mirror.Apply(lattice);
  const std::uint64_t plane = 512 * 512;
  for (const std::uint64_t first : {8, 12, 16, 20}) {
    mirror.Apply(Tiles({{{first * plane, 4 * plane}, 3.0f}}));
  }
  mirror.Apply(Bricks({5}, 2.0f));
  EXPECT_EQ(mirror.bricks().Value(0, 0, 40), 2.0f);
  EXPECT_EQ(mirror.bricks().Value(64, 4095, 0), 3.0f);
  EXPECT_EQ(mirror.bricks().Value(4095, 4095, 4095), -5.0f);
  int several = 0;
  const Vec3i& blocks = mirror.bricks().block_count();
  for (int n = 0; n < blocks.prod(); ++n) {
    const auto number = static_cast<std::uint64_t>(n);
    several += mirror.bricks().Only(BrickWithNumber(number, blocks)) ? 0 : 1;
  }
  EXPECT_EQ(several, 1);
  EXPECT_EQ(mirror.TakeChanges().bricks, (std::vector<BrickRun>{{5, 1}, {8 * plane, 16 * plane}}));
}

// Bytes on the heap for each of 16³ bricks of noise, in a mirror and the copy that a viewer takes.
template <class T>
double BytesPerBrick() {
  VolumeLattice lattice = Lattice();
  lattice.size = Vec3i::Constant(128);
  lattice.type = kLeafTypeOf<T>;
  std::mt19937 random(3);
  std::vector<T> values(64 * kBrickVoxels);
  const std::size_t before = mallinfo2().uordblks;
  VolumeMirror mirror;
  VolumeCopy copy;
  mirror.Apply(lattice);
  std::optional<VolumeUpdate> taken;
  for (std::uint64_t first = 0; first < 4096; first += 64) {
    VolumeBricks bricks = Bricks<T>({}, 0);
    for (std::uint64_t n = first; n < first + 64; ++n) bricks.numbers.push_back(n);
    for (T& value : values) value = static_cast<T>(random() % 200);
    bricks.zstd_values = Compress(std::span<const T>(values));
    mirror.Apply(bricks);
    copy.Merge(mirror);
    taken = copy.Take();
  }
  return static_cast<double>(mallinfo2().uordblks - before) / 4096.0;
}

// A sanitizer's heap counts nothing here.
TEST(VolumeMirror, ACopyTakesTheMemoryOfItsType) {
  EXPECT_LE(BytesPerBrick<std::uint8_t>(), 1.25 * 512);
  EXPECT_LE(BytesPerBrick<std::int16_t>(), 1.13 * 1024);
  EXPECT_LE(BytesPerBrick<float>(), 1.08 * 2048);
}

TEST(VolumeMirror, BricksThatWereHandedOutStay) {
  VolumeMirror mirror = Begun();
  const TypedBrickPtr before = mirror.bricks().At(2);
  mirror.Apply(Bricks({2}, 3.0f));
  EXPECT_EQ((*before)[0], -5.0f);
  EXPECT_EQ((*mirror.bricks().At(2))[0], 3.0f);
}

TEST(VolumeMirror, TheOverviewIsThereWhenItIsWholeUntilAnotherVolumeVoidsTheCopy) {
  VolumeMirror mirror = Begun();
  mirror.Apply(VolumePlacement{});
  mirror.Apply(Overview(0, 12));
  EXPECT_TRUE(mirror.overview().empty());
  mirror.Apply(Overview(12, 18));
  ASSERT_EQ(mirror.overview().size(), 30u);
  EXPECT_EQ(mirror.overview()[29], 0.5f);
  mirror.Apply(Complete({-5, -5, -5, -5, -5, -5}));
  mirror.Apply(Lattice());
  EXPECT_FALSE(mirror.resume());
  EXPECT_FALSE(mirror.placement());
  EXPECT_TRUE(mirror.overview().empty());
}

TEST(VolumeMirror, RefusesWhatMakesNoSense) {
  for (const VolumeEvent& early : std::initializer_list<VolumeEvent>{
           Bricks({0}), Overview(0, 30), Complete({}), Complete({-5, -5, -5, -5, -5, -5})}) {
    ExpectRefused(VolumeMirror(), early);
  }
  ExpectRefused(Begun(), Bricks({}));
  ExpectRefused(Begun(), Bricks({6}));
  ExpectRefused(Begun(), Bricks({~std::uint64_t{0}}));
  ExpectRefused(Begun(), Bricks({1, 0}));
  ExpectRefused(Begun(), Bricks({1, 1}));
  std::vector<std::uint64_t> many(4097);
  for (std::size_t n = 0; n < many.size(); ++n) many[n] = n;
  ExpectRefused(Begun(), VolumeBricks{LeafType::kFloat, many, "", {}, 0});
  VolumeBricks left = Bricks({1});
  left.bricks_left = 7;
  ExpectRefused(Begun(), left);
  // Values of another number of bricks.
  VolumeBricks mixed = Bricks({1, 2});
  mixed.numbers = {1};
  ExpectRefused(Begun(), mixed);
  mixed.numbers = {1, 2, 3};
  ExpectRefused(Begun(), mixed);
  // Voxels of another type.
  mixed = Bricks({1});
  mixed.type = LeafType::kInt16;
  ExpectRefused(Begun(), mixed);
  for (const BrickRun& bad : std::initializer_list<BrickRun>{
           {0, 0}, {6, 1}, {5, 2}, {0, 7}, {~std::uint64_t{0}, 1}, {3, ~std::uint64_t{0}}}) {
    ExpectRefused(Begun(), Tiles({{bad, 1.0f}}));
  }
  VolumeLattice large = Lattice();
  large.size = Vec3i::Constant(2048);
  VolumeMirror filled;
  filled.Apply(large);
  ExpectRefused(std::move(filled), Tiles({{{0, 1 << 19}, 1.0f}, {{1 << 20, (1 << 19) + 1}, 1.0f}}));
  ExpectRefused(Begun(), Tiles({{{2, 2}, 1.0f}, {{3, 1}, 1.0f}}));
  ExpectRefused(Begun(), Tiles({{{2, 2}, 1.0f}, {{1, 1}, 1.0f}}));
  VolumeBricks within = Bricks({1, 4});
  within.tiles = {{{3, 2}, 1.0f}};
  ExpectRefused(Begun(), within);
  ExpectRefused(Begun(), Overview(1, 29));
  ExpectRefused(Begun(), Overview(0, 31));
  VolumeOverview small = Overview(0, 30);
  small.size = Vec3i(3, 2, 4);
  ExpectRefused(Begun(), small);
  small = Overview(0, 30);
  small.zstd_values = "no zstd";
  ExpectRefused(Begun(), small);
}

TEST(VolumeMirror, RefusesLatticesThatCannotBe) {
  const auto with_size = [](int x, int y, int z) {
    VolumeLattice lattice = Lattice();
    lattice.size = Vec3i(x, y, z);
    return lattice;
  };
  for (const VolumeLattice& bad : {with_size(0, 1, 1), with_size(1, -1, 1), with_size(1, 1, 0)}) {
    ExpectRefused(Begun(), bad);
  }
  constexpr int kMost = std::numeric_limits<int>::max();
  for (const VolumeLattice& large :
       {with_size(kMost, kMost, kMost), with_size(kMost, 1, 1), with_size(4096, 4096, 4097)}) {
    ExpectRefused(Begun(), large, ErrorKind::kTooLarge);
  }
  // Few voxels, in 64 times as many of bricks.
  for (const VolumeLattice& thin : {with_size(1 << 30, 1, 1), with_size(1, 1, 1 << 30)}) {
    ExpectRefused(VolumeMirror(std::uint64_t{1} << 31), thin, ErrorKind::kTooLarge);
  }
  VolumeMirror limited(10 * 8 * 17 - 1);
  EXPECT_EQ(Refusal([&] { limited.Apply(Lattice()); }), ErrorKind::kTooLarge);
  VolumeLattice endless = Lattice();
  endless.value_min = std::nan("");
  ExpectRefused(Begun(), endless);
}

TEST(VolumeMirror, ACopyThatIsNotEqualIsNotComplete) {
  const auto changed = [] {
    VolumeMirror mirror = Begun();
    mirror.Apply(Bricks({1}, 2.0f));
    return mirror;
  };
  ExpectRefused(changed(), Complete({-5, 2, -5, -5, -5, 2}), ErrorKind::kInternal);
  ExpectRefused(changed(), Complete({-5, std::nextafter(2.0f, 3.0f), -5, -5, -5, -5}),
                ErrorKind::kInternal);
  // The same bricks in other places.
  ExpectRefused(changed(), Complete({2, -5, -5, -5, -5, -5}), ErrorKind::kInternal);
  changed().Apply(Complete({-5, 2, -5, -5, -5, -5}));
}

constexpr int kCopySize = 40;

VolumeLattice CubeLattice(int edge = kCopySize) {
  VolumeLattice lattice = Lattice();
  lattice.size = Vec3i::Constant(edge);
  return lattice;
}

// What a viewer makes of the changes alone.
struct CopyViewer {
  std::vector<TypedBrickPtr> bricks;

  void Take(const VolumeUpdate& update) {
    if (update.all && update.lattice) {
      bricks.assign(update.lattice->Bricks(),
                    TypedBrick::Constant(LeafType::kFloat, update.lattice->Background()));
    }
    for (const BrickRun& run : update.changed) {
      for (std::uint64_t n = run.first; n < run.end(); ++n) bricks[n] = update.bricks->At(n);
    }
  }
};

class VolumeCopyTest : public ::testing::Test {
 protected:
  VolumeCopyTest() { mirror_.Apply(CubeLattice()); }
  VolumeUpdate Take() {
    copy_.Merge(mirror_);
    std::optional<VolumeUpdate> update = copy_.Take();
    EXPECT_TRUE(update);
    return update.value_or(VolumeUpdate());
  }

  VolumeMirror mirror_;
  VolumeCopy copy_;
};

TEST_F(VolumeCopyTest, SaysNothingWhereNothingChanged) {
  VolumeMirror empty;
  VolumeCopy copy;
  EXPECT_FALSE(copy.Merge(empty));
  EXPECT_FALSE(copy.Take());
  EXPECT_TRUE(copy_.Merge(mirror_));
  EXPECT_FALSE(copy_.Merge(mirror_));
  EXPECT_TRUE(copy_.Take());
  EXPECT_FALSE(copy_.Take());
}

TEST_F(VolumeCopyTest, BackgroundIsNotListed) {
  mirror_.Apply(Bricks({3, 7}, 5.0f));
  const VolumeUpdate update = Take();
  EXPECT_TRUE(update.all);
  EXPECT_EQ(update.changed, (std::vector<BrickRun>{{3, 1}, {7, 1}}));
}

TEST_F(VolumeCopyTest, ManyChangesOfABrickAreOneAndTheNewest) {
  Take();
  for (int n = 1; n <= 1000; ++n) {
    mirror_.Apply(Bricks({4}, static_cast<float>(n)));
    copy_.Merge(mirror_);
  }
  const VolumeUpdate update = Take();
  EXPECT_FALSE(update.all);
  EXPECT_EQ(update.changed, (std::vector<BrickRun>{{4, 1}}));
  EXPECT_EQ((*update.bricks->At(4))[0], 1000.0f);
}

TEST_F(VolumeCopyTest, AnotherVolumeVoidsWhatWasNotTaken) {
  mirror_.Apply(Bricks({100}, 5.0f));
  copy_.Merge(mirror_);
  mirror_.Apply(CubeLattice(8));
  const VolumeUpdate update = Take();
  ASSERT_TRUE(update.lattice);
  EXPECT_TRUE(update.all);
  EXPECT_EQ(update.lattice->size, Vec3i::Constant(8));
  EXPECT_TRUE(update.changed.empty());
  // A copy that is void names no volume at all.
  mirror_.Reset();
  const VolumeUpdate none = Take();
  EXPECT_TRUE(none.all);
  EXPECT_FALSE(none.lattice || none.complete);
}

TEST_F(VolumeCopyTest, TheOverviewComesOncePerVolume) {
  const Vec3i size = Vec3i::Constant(OverviewCount(kCopySize));
  mirror_.Apply(VolumeOverview{
      size, 0, Compress(std::span<const float>(std::vector<float>(size.prod(), 2.0f)))});
  copy_.Merge(mirror_);
  mirror_.Apply(Bricks({1}, 3.0f));
  const VolumeUpdate first = Take();
  EXPECT_EQ(first.overview.size(), static_cast<std::size_t>(size.prod()));
  EXPECT_EQ(first.overview_size, size);
  mirror_.Apply(Bricks({1}, 4.0f));
  EXPECT_TRUE(Take().overview.empty());
}

TEST_F(VolumeCopyTest, APlaceIsAChange) {
  Take();
  VolumePlacement placement;
  placement.settings_revision = 2;
  mirror_.Apply(placement);
  const VolumeUpdate update = Take();
  ASSERT_TRUE(update.placement);
  EXPECT_EQ(update.placement->settings_revision, 2u);
  mirror_.Apply(placement);
  EXPECT_FALSE(copy_.Merge(mirror_));
}

// One thread changes volumes and bricks, another takes; at the end both are equal.
TEST_F(VolumeCopyTest, WhatIsTakenAddsUpWhileItChanges) {
  CopyViewer viewer;
  std::atomic<bool> done{false};
  std::thread drawer([&] {
    while (!done) {
      if (const auto update = copy_.Take()) viewer.Take(*update);
    }
  });
  std::mt19937 random(5);
  for (int n = 0; n < 3000; ++n) {
    if (n % 500 == 0) mirror_.Apply(CubeLattice());
    std::uint64_t first = random() % 120;
    mirror_.Apply(Bricks({first, first + 2, first + 5}, static_cast<float>(n)));
    if (n % 3 == 0) mirror_.Apply(Tiles({{{first, 1 + random() % 4}, static_cast<float>(-n)}}));
    copy_.Merge(mirror_);
  }
  done = true;
  drawer.join();
  if (const auto update = copy_.Take()) viewer.Take(*update);
  ASSERT_EQ(viewer.bricks.size(), mirror_.lattice()->Bricks());
  for (std::uint64_t n = 0; n < viewer.bricks.size(); ++n) {
    ASSERT_EQ(viewer.bricks[n]->Floats(), mirror_.bricks().At(n)->Floats()) << n;
  }
}

}  // namespace
}  // namespace palpate::client
