// What a viewer is handed of a mirror, merged.
#include "client/sdk/volume_copy.h"

#include <gtest/gtest.h>

#include <atomic>
#include <random>
#include <thread>

#include "common/bricks/float_codec.h"

namespace palpate::client {
namespace {

constexpr int kCopySize = 40;

VolumeLattice CubeLattice() {
  VolumeLattice lattice;
  lattice.source = "test";
  lattice.size = Vec3i::Constant(kCopySize);
  lattice.value_max = 100.0;
  return lattice;
}

VolumeBricks ConstantBricks(const std::vector<std::uint64_t>& numbers, float value,
                            std::uint64_t left = 0) {
  return {numbers, CompressFloats(std::vector<float>(numbers.size() * kBrickVoxels, value)), left};
}

// What a viewer makes of the updates.
struct CopyViewer {
  std::vector<BrickPtr> bricks;
  bool complete = false;

  void Take(const VolumeUpdate& update) {
    if (update.all) {
      const float background = update.lattice ? update.lattice->Background() : 0.0f;
      auto brick = std::make_shared<Brick>();
      brick->fill(background);
      bricks.assign(update.lattice ? update.lattice->Bricks() : 0, brick);
    }
    for (const ChangedBrick& changed : update.bricks) bricks[changed.number] = changed.brick;
    complete = update.complete.has_value();
  }
  void ExpectEqual(const VolumeMirror& mirror) const {
    ASSERT_EQ(bricks.size(), mirror.lattice()->Bricks());
    for (std::uint64_t n = 0; n < bricks.size(); ++n) ASSERT_EQ(*bricks[n], *mirror.At(n)) << n;
  }
};

TEST(VolumeCopy, SaysNothingWhereNothingChanged) {
  VolumeMirror mirror;
  VolumeCopy copy;
  EXPECT_FALSE(copy.Merge(mirror));
  EXPECT_FALSE(copy.Take());
  mirror.Apply(CubeLattice());
  EXPECT_TRUE(copy.Merge(mirror));
  EXPECT_FALSE(copy.Merge(mirror));
  EXPECT_TRUE(copy.Take());
  EXPECT_FALSE(copy.Take());
}

TEST(VolumeCopy, BackgroundIsNotListed) {
  VolumeMirror mirror;
  VolumeCopy copy;
  mirror.Apply(CubeLattice());
  mirror.Apply(ConstantBricks({3, 7}, 5.0f));
  copy.Merge(mirror);
  const auto update = copy.Take();
  ASSERT_TRUE(update);
  EXPECT_TRUE(update->all);
  ASSERT_EQ(update->bricks.size(), 2u);
  EXPECT_EQ(update->bricks[0].number, 3u);
  EXPECT_EQ(update->bricks[1].number, 7u);
}

TEST(VolumeCopy, ManyChangesOfABrickAreOneAndTheNewest) {
  VolumeMirror mirror;
  VolumeCopy copy;
  mirror.Apply(CubeLattice());
  copy.Merge(mirror);
  copy.Take();
  for (int n = 1; n <= 1000; ++n) {
    mirror.Apply(ConstantBricks({4}, static_cast<float>(n)));
    copy.Merge(mirror);
  }
  const auto update = copy.Take();
  ASSERT_TRUE(update);
  EXPECT_FALSE(update->all);
  ASSERT_EQ(update->bricks.size(), 1u);
  EXPECT_EQ(update->bricks[0].brick->front(), 1000.0f);
}

TEST(VolumeCopy, AnotherVolumeVoidsWhatWasNotTaken) {
  VolumeMirror mirror;
  VolumeCopy copy;
  mirror.Apply(CubeLattice());
  mirror.Apply(ConstantBricks({100}, 5.0f));
  copy.Merge(mirror);
  VolumeLattice smaller = CubeLattice();
  smaller.size = Vec3i::Constant(8);
  mirror.Apply(smaller);
  copy.Merge(mirror);
  const auto update = copy.Take();
  ASSERT_TRUE(update && update->lattice);
  EXPECT_TRUE(update->all);
  EXPECT_EQ(update->lattice->size, Vec3i::Constant(8));
  EXPECT_TRUE(update->bricks.empty());
  // A copy that is void names no volume at all.
  mirror.Reset();
  EXPECT_TRUE(copy.Merge(mirror));
  const auto none = copy.Take();
  ASSERT_TRUE(none);
  EXPECT_TRUE(none->all);
  EXPECT_FALSE(none->lattice || none->complete);
}

TEST(VolumeCopy, TheOverviewComesOncePerVolume) {
  VolumeMirror mirror;
  VolumeCopy copy;
  mirror.Apply(CubeLattice());
  const Vec3i size = Vec3i::Constant(OverviewCount(kCopySize));
  mirror.Apply(VolumeOverview{size, 0, CompressFloats(std::vector<float>(size.prod(), 2.0f))});
  copy.Merge(mirror);
  mirror.Apply(ConstantBricks({1}, 3.0f));
  copy.Merge(mirror);
  const auto first = copy.Take();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->overview.size(), static_cast<std::size_t>(size.prod()));
  EXPECT_EQ(first->overview_size, size);
  mirror.Apply(ConstantBricks({1}, 4.0f));
  copy.Merge(mirror);
  EXPECT_TRUE(copy.Take()->overview.empty());
}

TEST(VolumeCopy, APlaceIsAChange) {
  VolumeMirror mirror;
  VolumeCopy copy;
  mirror.Apply(CubeLattice());
  copy.Merge(mirror);
  copy.Take();
  VolumePlacement placement;
  placement.settings_revision = 2;
  mirror.Apply(placement);
  EXPECT_TRUE(copy.Merge(mirror));
  const auto update = copy.Take();
  ASSERT_TRUE(update && update->placement);
  EXPECT_EQ(update->placement->settings_revision, 2u);
  mirror.Apply(placement);
  EXPECT_FALSE(copy.Merge(mirror));
}

// One thread changes volumes and bricks, another takes; at the end both are equal.
TEST(VolumeCopy, WhatIsTakenAddsUpWhileItChanges) {
  VolumeMirror mirror;
  VolumeCopy copy;
  CopyViewer viewer;
  std::atomic<bool> done{false};
  std::thread drawer([&] {
    while (!done) {
      if (const auto update = copy.Take()) viewer.Take(*update);
    }
  });
  std::mt19937 random(5);
  for (int n = 0; n < 3000; ++n) {
    if (n % 500 == 0) mirror.Apply(CubeLattice());
    std::uint64_t first = random() % 120;
    mirror.Apply(ConstantBricks({first, first + 2, first + 5}, static_cast<float>(n)));
    copy.Merge(mirror);
  }
  done = true;
  drawer.join();
  if (const auto update = copy.Take()) viewer.Take(*update);
  viewer.ExpectEqual(mirror);
}

}  // namespace
}  // namespace palpate::client
