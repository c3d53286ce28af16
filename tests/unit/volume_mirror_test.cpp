// The copy of a client: messages that make no sense, damage, what changed; and reconnecting.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <thread>
#include <vector>

#include "client/sdk/backoff.h"
#include "client/sdk/volume_copy.h"
#include "client/sdk/volume_mirror.h"
#include "common/bricks/float_codec.h"
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

VolumeBricks Bricks(std::vector<std::uint64_t> numbers, float value = 1.0f) {
  const std::vector<float> values(numbers.size() * kBrickVoxels, value);
  return {std::move(numbers), CompressFloats(values), 0};
}

VolumeOverview Overview(std::uint64_t first, std::size_t count) {
  return {Vec3i(3, 2, 5), first, CompressFloats(std::vector<float>(count, 0.5f))};
}

// Of bricks that are constant.
VolumeComplete Complete(const std::vector<float>& values, std::uint64_t revision = 4) {
  VolumeComplete complete{{9, revision}, {}};
  for (std::size_t n = 0; n < values.size(); ++n) {
    Brick brick;
    brick.fill(values[n]);
    complete.content_hash += HashOfBrick(brick, n);
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
  EXPECT_EQ(mirror.Value(9, 7, 16), -5.0f);
  mirror.Apply(Bricks({1, 5}, 2.0f));
  mirror.Apply(Complete({-5, 2, -5, -5, -5, 2}));
  EXPECT_TRUE(mirror.is_complete());
  EXPECT_EQ(*mirror.resume(), (VolumeRevision{9, 4}));
  EXPECT_EQ(mirror.Value(0, 0, 8), 2.0f);
  EXPECT_EQ(mirror.Value(7, 7, 7), -5.0f);
  EXPECT_EQ(mirror.Value(8, 0, 16), 2.0f);
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
  EXPECT_TRUE(mirror.TakeChanges().numbers.empty());
  mirror.Apply(Bricks({3, 4}));
  mirror.Apply(Bricks({0, 4}));
  const MirrorChanges changes = mirror.TakeChanges();
  EXPECT_FALSE(changes.all);
  EXPECT_EQ(changes.numbers, (std::vector<std::uint64_t>{0, 3, 4}));
  mirror.Apply(Bricks({3}));
  mirror.Apply(Lattice());
  mirror.Apply(Bricks({2}));
  EXPECT_TRUE(mirror.TakeChanges().all);
}

TEST(VolumeMirror, BricksThatWereHandedOutStay) {
  VolumeMirror mirror = Begun();
  const BrickPtr before = mirror.At(2);
  mirror.Apply(Bricks({2}, 3.0f));
  EXPECT_EQ((*before)[0], -5.0f);
  EXPECT_EQ((*mirror.At(2))[0], 3.0f);
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
  ExpectRefused(Begun(), VolumeBricks{many, "", 0});
  VolumeBricks left = Bricks({1});
  left.bricks_left = 7;
  ExpectRefused(Begun(), left);
  // Values of another number of bricks.
  VolumeBricks mixed = Bricks({1, 2});
  mixed.numbers = {1};
  ExpectRefused(Begun(), mixed);
  mixed.numbers = {1, 2, 3};
  ExpectRefused(Begun(), mixed);
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
  for (const VolumeLattice& large : {with_size(kMost, kMost, kMost), with_size(2048, 1024, 1025)}) {
    ExpectRefused(Begun(), large, ErrorKind::kTooLarge);
  }
  // Few voxels, in 64 times as many of bricks.
  for (const VolumeLattice& thin : {with_size(kMost, 1, 1), with_size(1, 1, 1 << 30)}) {
    ExpectRefused(Begun(), thin, ErrorKind::kTooLarge);
  }
  VolumeMirror limited(10 * 8 * 17 - 1);
  EXPECT_EQ(Refusal([&] { limited.Apply(Lattice()); }), ErrorKind::kTooLarge);
  VolumeLattice endless = Lattice();
  endless.value_min = std::nan("");
  ExpectRefused(Begun(), endless);
}

TEST(VolumeMirror, ACopyThatIsNotEqualIsNotComplete) {
  VolumeMirror mirror = Begun();
  mirror.Apply(Bricks({1}, 2.0f));
  ExpectRefused(mirror, Complete({-5, 2, -5, -5, -5, 2}), ErrorKind::kInternal);
  ExpectRefused(mirror, Complete({-5, std::nextafter(2.0f, 3.0f), -5, -5, -5, -5}),
                ErrorKind::kInternal);
  // The same bricks in other places.
  ExpectRefused(mirror, Complete({2, -5, -5, -5, -5, -5}), ErrorKind::kInternal);
  mirror.Apply(Complete({-5, 2, -5, -5, -5, -5}));
}

TEST(FloatCodec, RoundTripsAnyBits) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const std::vector<float>& values :
       {std::vector<float>{}, {0.0f}, {-0.0f, nan, -infinity, 1e-42f}, std::vector<float>(99999)}) {
    const std::string bytes = CompressFloats(values);
    ASSERT_EQ(CountFloats(bytes, values.size()), values.size());
    std::vector<float> back(values.size(), 7.0f);
    DecompressFloats(bytes, back);
    if (values.empty()) continue;
    EXPECT_EQ(std::memcmp(back.data(), values.data(), values.size() * sizeof(float)), 0);
    EXPECT_EQ(Refusal([&] { CountFloats(bytes, values.size() - 1); }), ErrorKind::kInvalidArgument);
    back.resize(values.size() - 1);
    EXPECT_EQ(Refusal([&] { DecompressFloats(bytes, back); }), ErrorKind::kInvalidArgument);
    back.resize(values.size() + 1);
    EXPECT_EQ(Refusal([&] { DecompressFloats(bytes, back); }), ErrorKind::kInvalidArgument);
    EXPECT_EQ(Refusal([&] { DecompressFloats(bytes.substr(0, bytes.size() / 2), back); }),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(Refusal([&] { CountFloats("", 8); }), ErrorKind::kInvalidArgument);
}

constexpr int kCopySize = 40;

VolumeLattice CubeLattice(int edge = kCopySize) {
  VolumeLattice lattice = Lattice();
  lattice.size = Vec3i::Constant(edge);
  return lattice;
}

// What a viewer makes of the updates.
struct CopyViewer {
  std::vector<BrickPtr> bricks;

  void Take(const VolumeUpdate& update) {
    if (update.all) {
      auto background = std::make_shared<Brick>();
      background->fill(update.lattice ? update.lattice->Background() : 0.0f);
      bricks.assign(update.lattice ? update.lattice->Bricks() : 0, background);
    }
    for (const ChangedBrick& changed : update.bricks) bricks[changed.number] = changed.brick;
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
  ASSERT_EQ(update.bricks.size(), 2u);
  EXPECT_EQ(update.bricks[0].number, 3u);
  EXPECT_EQ(update.bricks[1].number, 7u);
}

TEST_F(VolumeCopyTest, ManyChangesOfABrickAreOneAndTheNewest) {
  Take();
  for (int n = 1; n <= 1000; ++n) {
    mirror_.Apply(Bricks({4}, static_cast<float>(n)));
    copy_.Merge(mirror_);
  }
  const VolumeUpdate update = Take();
  EXPECT_FALSE(update.all);
  ASSERT_EQ(update.bricks.size(), 1u);
  EXPECT_EQ(update.bricks[0].brick->front(), 1000.0f);
}

TEST_F(VolumeCopyTest, AnotherVolumeVoidsWhatWasNotTaken) {
  mirror_.Apply(Bricks({100}, 5.0f));
  copy_.Merge(mirror_);
  mirror_.Apply(CubeLattice(8));
  const VolumeUpdate update = Take();
  ASSERT_TRUE(update.lattice);
  EXPECT_TRUE(update.all);
  EXPECT_EQ(update.lattice->size, Vec3i::Constant(8));
  EXPECT_TRUE(update.bricks.empty());
  // A copy that is void names no volume at all.
  mirror_.Reset();
  const VolumeUpdate none = Take();
  EXPECT_TRUE(none.all);
  EXPECT_FALSE(none.lattice || none.complete);
}

TEST_F(VolumeCopyTest, TheOverviewComesOncePerVolume) {
  const Vec3i size = Vec3i::Constant(OverviewCount(kCopySize));
  mirror_.Apply(VolumeOverview{size, 0, CompressFloats(std::vector<float>(size.prod(), 2.0f))});
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
    copy_.Merge(mirror_);
  }
  done = true;
  drawer.join();
  if (const auto update = copy_.Take()) viewer.Take(*update);
  ASSERT_EQ(viewer.bricks.size(), mirror_.lattice()->Bricks());
  for (std::uint64_t n = 0; n < viewer.bricks.size(); ++n) {
    ASSERT_EQ(*viewer.bricks[n], *mirror_.At(n)) << n;
  }
}

TEST(Backoff, DoublesUpToTheLongestAndBeginsAnewAfterASuccess) {
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Backoff backoff(seed);
    for (const int longest_ms : {100, 200, 400, 800, 1600, 3200, 5000, 5000, 5000}) {
      const auto pause_ms = backoff.Next().count();
      EXPECT_LE(pause_ms, longest_ms);
      EXPECT_GT(pause_ms, longest_ms / 2);
    }
    for (int n = 0; n < 100; ++n) {
      const auto pause = backoff.Next();
      ASSERT_LE(pause, Backoff::kLongest);
      ASSERT_GT(pause, Backoff::kLongest / 2);
    }
    backoff.Reset();
    EXPECT_LE(backoff.Next(), Backoff::kFirst);
  }
}

TEST(Backoff, ManyClientsDoNotComeBackAtOnce) {
  std::set<std::int64_t> pauses_ms;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Backoff backoff(seed);
    for (int n = 0; n < 8; ++n) backoff.Next();
    pauses_ms.insert(backoff.Next().count());
  }
  EXPECT_GT(pauses_ms.size(), 150u);
}

}  // namespace
}  // namespace palpate::client
