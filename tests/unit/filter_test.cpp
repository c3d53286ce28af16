// Filters against OpenVDB's own on one grid of the whole volume, bit by bit.
#include "server/volume/edit/filter.h"
#include "server/volume/snapshot/openvdb_grids.h"

#include <gtest/gtest.h>
#include <openvdb/tools/Filter.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <random>
#include <set>

#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

using testing::Refusal;
using VolumePtr = std::shared_ptr<const VolumeSnapshot>;

constexpr FilterKind kKinds[] = {FilterKind::kGaussian, FilterKind::kMean, FilterKind::kMedian};

const FilterProgress kUntold = [](double) {};
const FilterCancelled kUncancelled = [] { return false; };

using testing::ForEachVoxel;
using testing::ValueAt;

VolumePtr AfterChanges(const VolumePtr& volume, const EditResult& result) {
  return testing::WithChanges(*volume, result.changes);
}

// Noise, so that any voxel that is read from a wrong place shows.
VolumePtr Noise(const Vec3i& size, unsigned seed) {
  std::mt19937 random(seed);
  return testing::MakeVolume(size, [&](int, int, int) {
    return std::uniform_real_distribution<double>(-1000, 2000)(random);
  });
}

// In leaves of the type, of what it can hold. Beyond the lattice the leaves hold other values than
// the background: they must not be read.
VolumePtr Typed(const Vec3i& size, LeafType type, unsigned seed) {
  std::mt19937 random(seed);
  const int low = type == LeafType::kInt16 ? -1024 : 3,
            high = type == LeafType::kUint8 ? 250 : 3071;
  const auto leaf = [&](const Vec3i&) {
    Brick values;
    for (float& value : values) {
      value = static_cast<float>(std::uniform_int_distribution<int>(low, high)(random));
    }
    return Leaf::Of(type, values);
  };
  return testing::VolumeOfLeaves(size, leaf, low, high);
}

openvdb::FloatGrid::Ptr PlainGrid(const VolumeSnapshot& volume) {
  const auto background = static_cast<float>(volume.metadata().value_min);
  const auto grid = openvdb::FloatGrid::create(background);
  auto accessor = grid->getAccessor();
  ForEachVoxel(volume.size(), [&](const Vec3i& p) {
    accessor.setValueOn(openvdb::Coord(p.x(), p.y(), p.z()), ValueAt(volume, p));
  });
  return grid;
}

openvdb::FloatGrid::Ptr FilteredByOpenVdb(const VolumeSnapshot& volume, const VolumeFilter& what) {
  const auto grid = PlainGrid(volume);
  openvdb::tools::Filter<openvdb::FloatGrid> filter(*grid);
  if (what.kind == FilterKind::kGaussian) filter.gaussian(what.width, what.iterations);
  if (what.kind == FilterKind::kMean) filter.mean(what.width, what.iterations);
  if (what.kind == FilterKind::kMedian) filter.median(what.width, what.iterations);
  return grid;
}

bool InRegion(const VolumeSnapshot& volume, const VolumeFilter& filter, const Vec3i& voxel) {
  const Vec3 p = filter.frame == EditFrame::kWorld
                     ? volume.metadata().WorldFromIndex().Apply(voxel.cast<double>())
                     : Vec3(voxel.cast<double>());
  if (const auto* sphere = std::get_if<SphereShape>(&filter.region)) {
    return (p - sphere->center).norm() <= sphere->radius;
  }
  if (const auto* box = std::get_if<BoxShape>(&filter.region)) {
    return (p.array() >= box->min.array()).all() && (p.array() <= box->max.array()).all();
  }
  return true;
}

// Every voxel, the box and the count of what changed, and that no brick is changed in vain.
void CheckResult(const VolumePtr& before, const VolumeFilter& filter, const EditResult& result) {
  const auto grid = FilteredByOpenVdb(*before, filter);
  const auto accessor = grid->getConstAccessor();
  const VolumePtr after = AfterChanges(before, result);
  const auto least = static_cast<float>(before->metadata().value_min);
  const auto greatest = static_cast<float>(before->metadata().value_max);
  Vec3i low = before->size(), high = -Vec3i::Ones();
  std::uint64_t count = 0;
  std::set<std::uint64_t> bricks;
  ForEachVoxel(before->size(), [&](const Vec3i& p) {
    const float was = ValueAt(*before, p), is = ValueAt(*after, p);
    const float raw = accessor.getValue(openvdb::Coord(p.x(), p.y(), p.z()));
    const float filtered = std::clamp(raw, least, greatest) + 0.0f;
    const float expected = InRegion(*before, filter, p) && filtered != was ? filtered : was;
    ASSERT_EQ(std::bit_cast<std::uint32_t>(is), std::bit_cast<std::uint32_t>(expected))
        << p.transpose() << ": " << is << ", not " << expected;
    if (is == was) return;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
    ++count;
    bricks.insert(before->bricks().NumberOf(p / kBrickEdge));
  });
  EXPECT_EQ(result.changed_voxels, count);
  EXPECT_EQ(result.changes.size(), bricks.size());
  ASSERT_EQ(result.changed.has_value(), count > 0);
  if (count > 0) {
    EXPECT_EQ(result.changed->min, low);
    EXPECT_EQ(result.changed->max, high);
  }
}

void Check(const VolumePtr& before, const VolumeFilter& filter) {
  SCOPED_TRACE(::testing::Message() << "kind " << static_cast<int>(filter.kind) << ", width "
                                    << filter.width << ", " << filter.iterations << " iterations");
  CheckResult(before, filter, ApplyFilter(before, filter));
}

TEST(Filter, EqualsOpenVdbOnAPlainGrid) {
  // Parts of 64 voxels: one and a bit, with bricks that stick out of the lattice.
  const VolumePtr volume = Noise(Vec3i(67, 30, 73), 1);
  for (const FilterKind kind : kKinds) {
    Check(volume, {.kind = kind});
    Check(volume, {.kind = kind, .width = 1, .iterations = 2});
    if (kind != FilterKind::kMedian) Check(volume, {.kind = kind, .width = 2});
  }
  Check(volume, {.kind = FilterKind::kMean, .width = 8});
  Check(volume, {.kind = FilterKind::kMean, .width = 3, .iterations = 2});
}

TEST(Filter, EqualsOpenVdbAcrossLargeParts) {
  // More than 8 voxels of reach: parts of 128 voxels.
  const VolumePtr volume = Noise(Vec3i(20, 17, 141), 2);
  Check(volume, {.kind = FilterKind::kGaussian, .width = 3});
  Check(volume, {.kind = FilterKind::kGaussian, .width = 1, .iterations = 8});
  Check(volume, {.kind = FilterKind::kMean, .width = 4, .iterations = 3});
  Check(volume, {.kind = FilterKind::kMedian, .width = 1, .iterations = 9});
}

TEST(Filter, AVolumeSmallerThanTheFilter) {
  const VolumePtr volume = Noise(Vec3i(3, 2, 5), 3);
  for (const FilterKind kind : kKinds) {
    Check(volume, {.kind = kind, .width = 2, .iterations = 2});
  }
  Check(volume, {.kind = FilterKind::kGaussian, .width = 8});
  Check(volume, {.kind = FilterKind::kMedian, .width = 8});
}

TEST(Filter, TypedVoxelsAreFilteredAsFloats) {
  for (const LeafType type : kLeafTypes) {
    const VolumePtr volume = Typed(Vec3i(19, 66, 21), type, 4);
    for (const FilterKind kind : kKinds) Check(volume, {.kind = kind});
    // A median has the values of its voxels: it stays in their type, but for the background.
    const VolumePtr after =
        AfterChanges(volume, ApplyFilter(volume, {.kind = FilterKind::kMedian}));
    EXPECT_EQ(after->bricks().At(Vec3i(1, 3, 1))->type(), type);
    const VolumePtr mean = AfterChanges(volume, ApplyFilter(volume, {.kind = FilterKind::kMean}));
    EXPECT_EQ(mean->bricks().At(Vec3i(1, 3, 1))->type(), LeafType::kFloat);
  }
}

// The mean of equal floats may be another float: nothing of that is left out.
TEST(Filter, ConstantBricksBecomeWhatOpenVdbMakesOfThem) {
  for (const float value : {0.0f, 0.1f, 0.7f, -0.3f, 127.0f, 1.0f}) {
    for (const float rest : {127.0f, 0.1f}) {
      const Vec3i size(24, 9, 90);
      const LeafPtr constant = Leaf::Constant(LeafType::kFloat, value);
      Brick other;
      other.fill(rest);
      other[77] = 40.0f;
      const LeafPtr edge = Leaf::Of(LeafType::kFloat, other);
      const auto leaf = [&](const Vec3i& brick) { return brick.z() == 11 ? edge : constant; };
      for (const double least : {-0.3, -5.0, static_cast<double>(value)}) {
        const VolumePtr volume = testing::VolumeOfLeaves(size, leaf, least, 200.0);
        SCOPED_TRACE(::testing::Message() << value << ' ' << rest << ' ' << least);
        Check(volume, {.kind = FilterKind::kMean, .width = 1});
        Check(volume, {.kind = FilterKind::kGaussian, .width = 2});
      }
    }
  }
}

TEST(Filter, ConstantBricksInTheMiddleAreShared) {
  // 3 x 24 bricks: the parts in the middle see one value only.
  const Vec3i size(192, 192, 192);
  const LeafPtr constant = Leaf::Constant(LeafType::kFloat, 0.1f);
  const VolumePtr volume = testing::VolumeOfLeaves(size, [&](const Vec3i&) { return constant; });
  const VolumeFilter filter{.kind = FilterKind::kMean,
                            .region = BoxShape{Vec3(64, 64, 64), Vec3(127, 127, 127)}};
  const EditResult result = ApplyFilter(volume, filter);
  ASSERT_EQ(result.changes.size(), 512u);
  std::set<const Leaf*> leaves;
  for (const BrickChange& change : result.changes) leaves.insert(change.values.get());
  EXPECT_EQ(leaves.size(), 1u);
  EXPECT_TRUE(result.changes[0].values->is_constant());
  CheckResult(volume, filter, result);
}

TEST(Filter, ARegionIsAllThatChanges) {
  const VolumePtr plain = Noise(Vec3i(70, 41, 66), 5);
  VolumeMetadata metadata = plain->metadata();
  metadata.spacing_mm = Vec3(0.5, 2.0, 1.25);
  metadata.origin_W_mm = Vec3(-10, 30, 5);
  metadata.direction = Eigen::AngleAxisd(0.4, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  const auto volume = std::make_shared<VolumeSnapshot>(metadata, plain->bricks(), 1, 1);
  for (const FilterKind kind : kKinds) {
    VolumeFilter filter{.kind = kind};
    filter.region = SphereShape{Vec3(60, 20, 62), 11.3};
    Check(volume, filter);
    filter.region = BoxShape{Vec3(-3, 7, 60), Vec3(69.5, 7.9, 64)};
    Check(volume, filter);
    filter.frame = EditFrame::kWorld;
    const Vec3 middle = metadata.WorldFromIndex().Apply(Vec3(35, 20, 64));
    filter.region = SphereShape{middle, 17.05};
    Check(volume, filter);
    filter.region = BoxShape{middle - Vec3(9, 9, 9), middle + Vec3(9, 9, 9)};
    Check(volume, filter);
  }
}

// A narrow band in a large box would be refused by every budget.
TEST(Filter, WhatCannotChangeClaimsNothing) {
  const Vec3i size(512, 512, 512);
  const LeafPtr far = Leaf::Constant(LeafType::kFloat, 0.0f);
  const auto leaf = [&](const Vec3i& brick) {
    return (brick - Vec3i(30, 30, 30)).cwiseAbs().maxCoeff() == 0 ? testing::FilledLeaf(0.5f) : far;
  };
  const VolumePtr volume = testing::VolumeOfLeaves(size, leaf);
  for (const FilterKind kind : kKinds) {
    const FilterRun run(volume, {.kind = kind});
    EXPECT_GT(run.MostBytes(), Leaf::Bytes(LeafType::kFloat)) << static_cast<int>(kind);
    EXPECT_LT(run.MostBytes(), 16u << 20) << static_cast<int>(kind);
  }
}

TEST(Filter, ARegionBetweenVoxelsIsNoChange) {
  const VolumePtr volume = Noise(Vec3i(20, 20, 20), 6);
  const VolumeFilter filter{.region = SphereShape{Vec3(5.5, 5.5, 5.5), 0.1}};
  FilterRun run(volume, filter);
  EXPECT_EQ(run.SecondsLeft(), 0.0);
  EXPECT_EQ(run.MostBytes(), 0u);
  run.Compute(kUntold, kUncancelled);
  run.MoveTo(AfterChanges(volume, ApplyFilter(volume, {})));
  EXPECT_EQ(run.SecondsLeft(), 0.0);
  EXPECT_TRUE(run.Result().changes.empty());
  EXPECT_FALSE(run.Result().changed.has_value());
}

// An edit may write all that the file's type holds.
TEST(Filter, KeepsWhatAnEditWrote) {
  const auto painted = testing::MakeVolume(Vec3i::Constant(24),
                                           [](int i, int, int) { return i < 12 ? 255.0 : 10.0; });
  VolumeMetadata metadata = painted->metadata();
  metadata.original_type = "uint8";
  metadata.value_min = 0.0;
  metadata.value_max = 200.0;  // as loaded
  const auto volume = std::make_shared<VolumeSnapshot>(metadata, painted->bricks(), 2, 1);
  for (const FilterKind kind : kKinds) {
    const VolumePtr after = AfterChanges(volume, ApplyFilter(volume, {.kind = kind}));
    EXPECT_EQ(ValueAt(*after, Vec3i(6, 12, 12)), 255.0f);
  }
}

TEST(Filter, ResultsStayWithinTheRangeAndHaveNoSignedZero) {
  // The range is narrower than the voxels, which were loaded before it was fixed.
  const VolumePtr noise = Noise(Vec3i(20, 20, 20), 7);
  VolumeMetadata metadata = noise->metadata();
  metadata.value_min = -100.0;
  metadata.value_max = 50.0;
  const auto narrow = std::make_shared<VolumeSnapshot>(metadata, noise->bricks(), 1, 1);
  for (const FilterKind kind : kKinds) Check(narrow, {.kind = kind});
  const VolumePtr zeros = testing::MakeVolume(Vec3i(20, 20, 20), [](int i, int, int) {
    return i < 10 ? -0.0 : i == 19 ? 1.0 : -1.0;
  });
  for (const FilterKind kind : kKinds) Check(zeros, {.kind = kind});
}

// What is left after an edit is computed again, and nothing else.
TEST(Filter, ItFollowsEdits) {
  std::mt19937 random(8);
  for (const FilterKind kind : kKinds) {
    for (const int iterations : {1, 2}) {
      const VolumeFilter filter{
          .kind = kind, .iterations = iterations, .region = SphereShape{Vec3(36, 12, 36), 34.0}};
      const VolumePtr loaded = Noise(Vec3i(73, 25, 71), 8);
      VolumePtr volume = loaded;
      FilterRun run(volume, filter);
      EXPECT_GT(run.SecondsLeft(), 0.0);
      run.Compute(kUntold, kUncancelled);
      EXPECT_EQ(run.SecondsLeft(), 0.0);
      for (int round = 0; round < 3; ++round) {
        for (int n = 0; n < 3; ++n) {
          const auto place = [&](int size) { return static_cast<double>(random() % size); };
          volume = AfterChanges(
              volume,
              ApplyEdit(*volume, {.shape = SphereShape{Vec3(place(73), place(25), place(71)), 2.0},
                                  .value = 10.0 * n}));
        }
        run.MoveTo(volume);
        EXPECT_GT(run.SecondsLeft(), 0.0);
        run.Compute(kUntold, kUncancelled);
        EXPECT_EQ(run.SecondsLeft(), 0.0);
      }
      CheckResult(volume, filter, run.Result());
      // Back to what it was: as if nothing had been.
      run.MoveTo(loaded);
      run.Compute(kUntold, kUncancelled);
      CheckResult(loaded, filter, run.Result());
      // The same values in other leaves change nothing.
      const LeafPtr copy =
          Leaf::Of(LeafType::kFloat, loaded->bricks().At(Vec3i(3, 2, 3))->Floats());
      run.MoveTo(testing::WithChanges(*loaded, std::vector<BrickChange>{{Vec3i(3, 2, 3), copy}}));
      EXPECT_EQ(run.SecondsLeft(), 0.0);
    }
  }
}

TEST(Filter, AnEditOutOfReachLeavesNothingToDo) {
  const VolumePtr volume = Noise(Vec3i(96, 16, 16), 9);
  const VolumeFilter filter{
      .kind = FilterKind::kMean, .width = 2, .region = BoxShape{Vec3(0, 0, 0), Vec3(31, 15, 15)}};
  FilterRun run(volume, filter);
  run.Compute(kUntold, kUncancelled);
  const auto touched = [&](double x) {
    return AfterChanges(volume, ApplyEdit(*volume, {.shape = BoxShape{Vec3(x, 3, 3), Vec3(x, 3, 3)},
                                                    .value = 123.0}));
  };
  run.MoveTo(touched(48));
  EXPECT_EQ(run.SecondsLeft(), 0.0);
  run.MoveTo(touched(33));
  EXPECT_GT(run.SecondsLeft(), 0.0);
}

TEST(Filter, CancellingIsPromptAndCanBeGoneOnWith) {
  const VolumePtr volume = Noise(Vec3i(70, 20, 20), 10);
  const VolumeFilter filter{.kind = FilterKind::kMedian, .width = 2};
  FilterRun run(volume, filter);
  int asked = 0;
  EXPECT_EQ(Refusal([&] { run.Compute(kUntold, [&] { return ++asked == 2; }); }),
            ErrorKind::kCancelled);
  EXPECT_EQ(asked, 2);
  EXPECT_GT(run.SecondsLeft(), 0.0);
  std::vector<double> fractions;
  run.Compute([&](double fraction) { fractions.push_back(fraction); }, kUncancelled);
  ASSERT_FALSE(fractions.empty());
  EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
  EXPECT_GT(fractions.front(), 0.0);
  EXPECT_EQ(fractions.back(), 1.0);
  CheckResult(volume, filter, run.Result());
}

TEST(Filter, WhatIsRefused) {
  const VolumePtr volume = Noise(Vec3i(20, 20, 20), 11);
  const double nan = std::nan("");
  for (const VolumeFilter& bad :
       {VolumeFilter{.width = 0}, VolumeFilter{.width = -3},
        VolumeFilter{.kind = FilterKind::kMean, .width = 9}, VolumeFilter{.iterations = 0},
        VolumeFilter{.iterations = -1}, VolumeFilter{.width = 1, .iterations = 9},
        VolumeFilter{.kind = FilterKind::kMean, .width = 8, .iterations = 5},
        VolumeFilter{.kind = FilterKind::kMedian, .width = 1, .iterations = 33},
        VolumeFilter{.kind = FilterKind::kMean, .width = 2, .iterations = 2147483647},
        VolumeFilter{.region = SphereShape{Vec3(5, 5, 5), 0.0}},
        VolumeFilter{.region = SphereShape{Vec3(5, nan, 5), 3.0}},
        VolumeFilter{.region = SphereShape{Vec3(90, 5, 5), 3.0}},
        VolumeFilter{.region = BoxShape{Vec3(5, 5, 5), Vec3(4, 9, 9)}},
        VolumeFilter{.region = BoxShape{Vec3(-9, -9, -9), Vec3(-3, 9, 9)}}}) {
    EXPECT_EQ(Refusal([&] { ApplyFilter(volume, bad); }), ErrorKind::kInvalidArgument)
        << bad.width << ' ' << bad.iterations;
  }
  for (const VolumeFilter& possible :
       {VolumeFilter{.width = 8}, VolumeFilter{.width = 1, .iterations = 8},
        VolumeFilter{.kind = FilterKind::kMean, .iterations = 32}}) {
    EXPECT_EQ(Refusal([&] { ApplyFilter(volume, possible); }), std::nullopt);
  }
}

}  // namespace
}  // namespace palpate
