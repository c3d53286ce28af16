// The viewer's copy of a volume against a plain array that is changed alongside.
#include "client/view/volume/view_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <random>

#include "tests/support/view_volumes.h"

namespace palpate::view {
namespace {

using client::VolumeUpdate;

constexpr float kMin = -5.0f, kMax = 27.0f;

VolumeLattice Lattice(const Vec3i& size) {
  VolumeLattice lattice;
  lattice.size = size;
  lattice.value_min = kMin;
  lattice.value_max = kMax;
  return lattice;
}

VolumeUpdate Next(const Vec3i& size) {
  VolumeUpdate update;
  update.lattice = Lattice(size);
  return update;
}
VolumeUpdate Beginning(const Vec3i& size) {
  VolumeUpdate update = Next(size);
  update.all = true;
  return update;
}

// Voxels one by one, and what follows from them by looking at all of them. And their bricks, as the
// client library would hold them.
class Model {
 public:
  explicit Model(const Vec3i& size)
      : voxels_(testing::MakeVoxels(size, [](int, int, int) { return kMin; })),
        bricks_(Lattice(size).BrickCounts(), TypedBrick::Constant(LeafType::kFloat, kMin)) {}

  float Value(const Vec3i& v) const { return voxels_.At(v.x(), v.y(), v.z()); }
  Vec3i Place(std::uint64_t number) const { return BrickWithNumber(number, bricks_.brick_count()); }
  // Changes each voxel of a brick.
  template <typename Change>
  void Seem(std::uint64_t number, const Change& change) {
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Vec3i v = Place(number) * kBrickEdge + Vec3i(n >> 6, n >> 3 & 7, n & 7);
      if ((v.array() >= size().array()).any()) continue;
      const std::size_t at = (static_cast<std::size_t>(v.x()) * size().y() + v.y()) * size().z();
      float& value = voxels_.values[at + v.z()];
      value = change(v, value);
    }
  }
  // The same, as the daemon would send it.
  template <typename Change>
  void Set(std::uint64_t number, const Change& change, VolumeUpdate& update,
           LeafType type = LeafType::kFloat) {
    Seem(number, change);
    bricks_.Put(number, testing::BrickOf(voxels_, Place(number), type));
    AddTo(update.changed, {number, 1});
  }
  // One value in a run of bricks: a tile.
  void Fill(BrickRun run, float value, VolumeUpdate& update) {
    for (std::uint64_t n = run.first; n < run.end(); ++n) {
      Seem(n, [&](const Vec3i&, float) { return value; });
    }
    bricks_.Fill(run, TypedBrick::Constant(LeafType::kFloat, value));
    update.changed.push_back(run);
  }
  VolumeUpdate Sent(VolumeUpdate update) {
    update.bricks = bricks_.Share();
    return update;
  }
  void ExpectEqual(const ViewVolume& volume) const {
    ExpectCounts(volume);
    for (int i = -1; i <= size().x(); ++i) {
      for (int j = -1; j <= size().y(); ++j) {
        for (int k = -1; k <= size().z(); ++k) {
          ASSERT_EQ(volume.Value({i, j, k}), Value({i, j, k})) << i << ' ' << j << ' ' << k;
        }
      }
    }
    ExpectRanges(volume);
  }
  const Vec3i& size() const { return voxels_.size; }

 private:
  // Stand-ins do not count.
  void ExpectCounts(const ViewVolume& volume) const {
    std::array<std::uint64_t, Histogram::kBins> counts{};
    for (int i = 0; i < size().x(); ++i) {
      for (int j = 0; j < size().y(); ++j) {
        for (int k = 0; k < size().z(); ++k) {
          const double bin =
              (volume.bricks().Value(i, j, k) - kMin) / (kMax - kMin) * Histogram::kBins;
          ++counts[static_cast<std::size_t>(std::clamp(bin, 0.0, Histogram::kBins - 1.0))];
        }
      }
    }
    ASSERT_EQ(volume.histogram().counts(), counts);
  }
  void ExpectRanges(const ViewVolume& volume) const {
    const Vec3i count = volume.cell_brick_count();
    // Cells -1 .. size - 1 along each axis.
    ASSERT_EQ(count, (size().array() + 8).matrix() / 8);
    const Vec3i blocks = (count.array() + 7).matrix() / 8;
    ASSERT_EQ(volume.cell_block_count(), blocks);
    ASSERT_EQ(volume.cell_blocks().size(), static_cast<std::size_t>(blocks.prod()));
    std::vector<std::optional<ValueRange>> of_blocks(volume.cell_blocks().size());
    for (int n = 0; n < count.prod(); ++n) {
      const Vec3i cell_brick = BrickWithNumber(n, count);
      const Vec3i first = cell_brick * 8 - Vec3i::Ones();
      ValueRange range{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
      for (int v = 0; v < 729; ++v) {
        const float value = Value(first + Vec3i(v / 81, v / 9 % 9, v % 9));
        range = {std::min(range.min, value), std::max(range.max, value)};
      }
      ASSERT_EQ(volume.RangeOf(cell_brick), range) << n;
      auto& of_block = of_blocks[BrickNumber(cell_brick / 8, blocks)];
      if (!of_block) of_block = range;
      of_block->Add(range);
    }
    for (std::size_t n = 0; n < of_blocks.size(); ++n) {
      ASSERT_EQ(volume.cell_blocks()[n].range, *of_blocks[n]) << n;
      ASSERT_EQ(!volume.cell_blocks()[n].bricks, of_blocks[n]->IsOneValue()) << n;
    }
  }

  testing::VoxelArray voxels_;
  BrickMap bricks_;
};

// What a graphics card would hold that takes up nothing but the changes: the values at the corners
// of each cell brick, and its range.
class Follower {
 public:
  void Take(ViewVolume& volume) {
    const VolumeChanges changes = volume.TakeChanges();
    if (changes.all) {
      held_.assign(static_cast<std::size_t>(volume.cell_brick_count().prod()), {});
      for (Held& held : held_) held.corners.assign(729, kMin);
    }
    std::uint64_t least = 0;
    for (const VolumeChanges::Block& block : changes.blocks) {
      ASSERT_GE(block.number, least);
      least = block.number + 1;
      TakeBlock(block, volume);
    }
  }
  void ExpectEqual(const ViewVolume& volume) const {
    const Vec3i count = volume.cell_brick_count();
    ASSERT_EQ(held_.size(), static_cast<std::size_t>(count.prod()));
    for (std::size_t n = 0; n < held_.size(); ++n) {
      const Held now = Of(volume, BrickWithNumber(n, count));
      ASSERT_EQ(held_[n].range, now.range) << n;
      ASSERT_EQ(held_[n].corners, now.corners) << n;
    }
  }

 private:
  struct Held {
    ValueRange range{kMin, kMin};
    std::vector<float> corners{};
  };
  static Held Of(const ViewVolume& volume, const Vec3i& cell_brick) {
    Held held{volume.RangeOf(cell_brick), {}};
    const Vec3i first = cell_brick * 8 - Vec3i::Ones();
    for (int v = 0; v < 729; ++v) {
      held.corners.push_back(volume.Value(first + Vec3i(v / 81, v / 9 % 9, v % 9)));
    }
    return held;
  }
  void TakeBlock(const VolumeChanges::Block& block, const ViewVolume& volume) {
    const Vec3i count = volume.cell_brick_count();
    const Vec3i first = BrickWithNumber(block.number, volume.cell_block_count()) * 8;
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Vec3i at = first + Vec3i(n >> 6, n >> 3 & 7, n & 7);
      if (!block.bricks[static_cast<std::size_t>(n)] || (at.array() >= count.array()).any()) {
        continue;
      }
      held_[BrickNumber(at, count)] = Of(volume, at);
    }
  }

  std::vector<Held> held_;
};

// Some bricks get new voxels: a few of them, all of them, one value, background. Of any type.
VolumeUpdate RandomUpdate(Model& model, std::mt19937& random, bool begins) {
  VolumeUpdate update = begins ? Beginning(model.size()) : Next(model.size());
  const std::uint64_t bricks = update.lattice->Bricks();
  std::vector<std::uint64_t> numbers;
  for (int n = 0; n < 1 + static_cast<int>(random() % 4); ++n) numbers.push_back(random() % bricks);
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  // Beyond the range at load too: an edit may leave it.
  std::uniform_real_distribution<float> uniform(-10.0f, 32.0f);
  for (const std::uint64_t number : numbers) {
    const auto kind = random() % 4;
    const LeafType type = kLeafTypes[random() % 4];
    const auto draw = [&] {
      const float value = uniform(random);
      return type == LeafType::kFloat   ? value
             : type == LeafType::kInt16 ? std::round(value)
                                        : std::abs(std::round(value));
    };
    const float value = kind == 3 ? kMin : draw();
    model.Set(
        number,
        [&](const Vec3i&, float old) {
          if (kind == 0) return random() % 100 == 0 ? draw() : old;
          return kind == 1 ? draw() : value;
        },
        update, type);
  }
  if (random() % 2 == 0) update.complete.emplace();
  update.bricks_left = update.complete ? 0 : random() % 5;
  return model.Sent(update);
}

TEST(ViewVolume, EqualsAPlainArrayThroughThousandsOfUpdates) {
  std::mt19937 random(7);
  for (const Vec3i& size : {Vec3i(19, 8, 13), Vec3i(16, 16, 24), Vec3i(2, 9, 33), Vec3i(1, 1, 1)}) {
    ViewVolume volume;
    Follower follower;
    Model model(size);
    for (int n = 0; n < 1000; ++n) {
      const bool begins = n % 250 == 0;
      if (begins) model = Model(size);
      const std::uint64_t version = volume.version();
      volume.Take(RandomUpdate(model, random, begins));
      if (begins) {
        ASSERT_GT(volume.version(), version);
      }
      model.ExpectEqual(volume);
      if (random() % 3 == 0) {
        follower.Take(volume);
        follower.ExpectEqual(volume);
      }
      if (HasFatalFailure()) return;
    }
  }
}

// Blocks of 64 voxels become constant and vary again.
TEST(ViewVolume, EqualsAPlainArrayWhereTilesFillWholeBlocks) {
  std::mt19937 random(11);
  for (const Vec3i& size : {Vec3i(70, 9, 135), Vec3i(129, 66, 64), Vec3i(128, 64, 8)}) {
    ViewVolume volume;
    Follower follower;
    Model model(size);
    const std::uint64_t bricks = Lattice(size).Bricks();
    for (int n = 0; n < 24; ++n) {
      if (n % 3 != 1) {
        volume.Take(RandomUpdate(model, random, n == 0));
      } else {
        VolumeUpdate update = Next(size);
        // Everything, or nearly everything.
        const std::uint64_t first = random() % 2 * (random() % 9);
        model.Fill({first, bricks - first}, random() % 2 == 0 ? kMin : 3.5f, update);
        volume.Take(model.Sent(update));
      }
      model.ExpectEqual(volume);
      follower.Take(volume);
      follower.ExpectEqual(volume);
      if (HasFatalFailure()) return;
    }
  }
}

// Two bricks in 2^36 voxels.
TEST(ViewVolume, ASparseVolumeCostsNoWorkPerBrickOfItsBox) {
  const Vec3i size = Vec3i::Constant(4096);
  VolumeUpdate update = Beginning(size);
  BrickMap bricks(update.lattice->BrickCounts(), TypedBrick::Constant(LeafType::kFloat, kMin));
  const auto voxels = testing::MakeVoxels({8, 8, 8}, [](int i, int, int) { return kMin + i; });
  for (const std::uint64_t number : {std::uint64_t{70000000}, bricks.size() - 1}) {
    bricks.Put(number, testing::BrickOf(voxels, Vec3i::Zero()));
    update.changed.push_back({number, 1});
  }
  update.bricks = bricks.Share();
  update.complete.emplace();
  ViewVolume volume;
  volume.Take(update);
  std::size_t varying = 0;
  for (const CellBlock& block : volume.cell_blocks()) varying += block.bricks ? 1 : 0;
  EXPECT_LE(varying, 16u);
  EXPECT_LE(volume.TakeChanges().blocks.size(), 16u);
  EXPECT_EQ(volume.Value(size - Vec3i::Ones()), kMin + 7);
  EXPECT_EQ(volume.RangeOf(volume.cell_brick_count() - Vec3i::Ones()),
            (ValueRange{kMin, kMin + 7}));
}

TEST(ViewVolume, TheOverviewStandsInForBricksUntilTheyCome) {
  const Vec3i size(19, 8, 13);
  Model model(size);
  ViewVolume volume;
  Follower follower;
  VolumeUpdate first = Beginning(size);
  const auto real = [&](const Vec3i& v, float) { return static_cast<float>(v.x() + v.z()); };
  model.Set(2, real, first);
  first = model.Sent(first);
  volume.Take(first);
  model.ExpectEqual(volume);

  VolumeUpdate overview = Next(size);
  overview.overview_size = Vec3i(5, 2, 4);
  for (int n = 0; n < 40; ++n) overview.overview.push_back(static_cast<float>(n) * 0.5f);
  const auto stand_in = [&](const Vec3i& v, float) {
    return overview.overview[(v.x() / 4 * 2 + v.y() / 4) * 4 + v.z() / 4];
  };
  model.Set(4, real, overview);
  overview.bricks_left = 3;
  for (const int n : {0, 1, 3, 5}) model.Seem(n, stand_in);
  overview = model.Sent(overview);
  volume.Take(overview);
  model.ExpectEqual(volume);
  EXPECT_EQ(volume.bricks_left(), 3u);
  EXPECT_FALSE(volume.revision());
  EXPECT_FALSE(volume.HasCome({0, 0, 0}) || volume.HasCome({1, 0, 1}));
  EXPECT_TRUE(volume.HasCome({2, 0, 0}));
  follower.Take(volume);
  follower.ExpectEqual(volume);

  VolumeUpdate last = Next(size);
  model.Set(1, real, last);
  // A brick that is the background, and no stand-in any more.
  const auto background = [](const Vec3i&, float) { return kMin; };
  model.Set(3, background, last);
  last = model.Sent(last);
  volume.Take(last);
  model.ExpectEqual(volume);
  EXPECT_GT(volume.bricks_left(), 0u);  // not complete, whatever is known of the rest

  // Those that never came are background.
  VolumeUpdate complete = Next(size);
  complete.complete = VolumeRevision{7, 3};
  for (const int n : {0, 5}) model.Seem(n, background);
  complete = model.Sent(complete);
  volume.Take(complete);
  model.ExpectEqual(volume);
  EXPECT_TRUE(volume.HasCome({0, 0, 0}));
  EXPECT_EQ(volume.bricks_left(), 0u);
  EXPECT_EQ(volume.revision(), complete.complete);
  follower.Take(volume);
  follower.ExpectEqual(volume);
}

// The graphics card holds a volume in its own type.
TEST(ViewVolume, MeansAreRoundedInAVolumeOfIntegers) {
  VolumeUpdate update = Beginning(Vec3i(8, 8, 8));
  update.lattice->type = LeafType::kInt16;
  update.overview_size = Vec3i(2, 2, 2);
  update.overview = {-1.6f, 0.4f, 2.0f, 3.7f, 1.0f, 1.0f, 1.0f, 1.0f};
  update.bricks = BrickMap({1, 1, 1}, TypedBrick::Constant(LeafType::kInt16, kMin)).Share();
  ViewVolume volume;
  volume.Take(update);
  EXPECT_EQ(volume.Value({0, 0, 0}), -2.0f);
  EXPECT_EQ(volume.Value({0, 0, 4}), 0.0f);
  EXPECT_EQ(volume.Value({3, 7, 7}), 4.0f);
  EXPECT_EQ(volume.RangeOf({0, 0, 0}), (ValueRange{kMin, 4.0f}));
}

TEST(ViewVolume, AnOverviewThatComesWithTheWholeVolumeIsNotShown) {
  const Vec3i size(8, 8, 16);
  Model model(size);
  ViewVolume volume;
  VolumeUpdate update = Beginning(size);
  update.overview_size = Vec3i(2, 2, 4);
  update.overview.assign(16, 3.0f);
  model.Set(
      1, [](auto&, float) { return 9.0f; }, update);
  update.complete.emplace();
  volume.Take(model.Sent(update));
  model.ExpectEqual(volume);
}

TEST(ViewVolume, AnUpdateWithoutALatticeIsAVoidVolume) {
  ViewVolume volume;
  EXPECT_FALSE(volume.lattice());
  Model model(Vec3i(9, 9, 9));
  volume.Take(model.Sent(Beginning(model.size())));
  VolumeUpdate placed = model.Sent(Next(model.size()));
  placed.placement.emplace().device_from_index.translation = Vec3(1, 2, 3);
  const std::uint64_t version = volume.version();
  volume.Take(placed);
  ASSERT_TRUE(volume.X_DI());
  EXPECT_EQ(volume.X_DI()->translation, Vec3(1, 2, 3));
  EXPECT_EQ(volume.version(), version);
  EXPECT_GT(volume.bricks_left(), 0u);
  volume.TakeChanges();
  // A change of one brick costs what it touches.
  VolumeUpdate edit = Next(model.size());
  model.Set(
      5, [](auto&, float) { return 4.0f; }, edit);
  volume.Take(model.Sent(edit));
  const VolumeChanges touched = volume.TakeChanges();
  ASSERT_EQ(touched.blocks.size(), 1u);
  EXPECT_EQ(touched.blocks.front().bricks.count(), 2u);  // (1, 0..1, 1) of 2 x 2 x 2

  VolumeUpdate none;
  none.all = true;
  volume.Take(none);
  EXPECT_FALSE(volume.lattice() || volume.X_DI());
  EXPECT_EQ(volume.bricks_left(), 0u);
  EXPECT_EQ(volume.cell_brick_count(), Vec3i::Zero());
  EXPECT_TRUE(volume.cell_blocks().empty());
  EXPECT_EQ(volume.histogram().counts(), Histogram().counts());
  const VolumeChanges changes = volume.TakeChanges();
  EXPECT_TRUE(changes.all && changes.blocks.empty());
  EXPECT_FALSE(volume.TakeChanges().all);
}

TEST(ViewVolume, InterpolatesIntoTheLayerOfBackground) {
  const Vec3i size(9, 10, 11);
  Model model(size);
  ViewVolume volume;
  VolumeUpdate update = Beginning(size);
  // Trilinear itself: the interpolant has its values everywhere within.
  const auto f = [](const Vec3& p) {
    return 1.0 + p.x() + 0.5 * p.y() - 0.25 * p.z() + 0.125 * p.x() * p.y() * p.z();
  };
  for (std::uint64_t n = 0; n < update.lattice->Bricks(); ++n) {
    model.Set(
        n, [&](const Vec3i& v, float) { return static_cast<float>(f(v.cast<double>())); }, update);
  }
  volume.Take(model.Sent(update));
  for (const Vec3& p :
       {Vec3(0, 0, 0), Vec3(7.5, 7.25, 7.75), Vec3(3, 8.5, 9.125), Vec3(8, 9, 10)}) {
    EXPECT_NEAR(volume.Interpolate(p), f(p), 1e-9) << p.transpose();
  }
  EXPECT_NEAR(volume.Interpolate({-0.25, 0, 0}), 0.75 * f(Vec3::Zero()) + 0.25 * kMin, 1e-9);
  EXPECT_NEAR(volume.Interpolate({8.75, 0, 0}), 0.25 * f({8, 0, 0}) + 0.75 * kMin, 1e-9);
  for (const double far : {-1.0, 9.0, -1.5, 11.5, 1e300, std::nan("")}) {
    EXPECT_EQ(volume.Interpolate({far, 1, 1}), kMin) << far;
  }
}

int EmptyBars(const Histogram& histogram) {
  const auto counts = histogram.bars().counts;
  return static_cast<int>(std::count(counts.begin(), counts.end(), 0u));
}

// uint8 voxels that a file scales: bins between two values stayed empty, as a comb.
TEST(ViewHistogram, ScaledWholeNumbersHaveNoEmptyBarsBetweenThem) {
  for (const int greatest : {2, 9, 100, 127, 128, 200, 253, 255}) {
    for (const float slope : {1.0f, 0.37f, 3921.7f}) {
      const float least = -17.3f;
      Histogram histogram(least, least + slope * static_cast<float>(greatest));
      for (int n = 0; n <= greatest; ++n)
        histogram.Add(least + slope * static_cast<float>(n), n + 1);
      EXPECT_EQ(EmptyBars(histogram), 0) << greatest << " times " << slope;
      const Histogram::Bars bars = histogram.bars();
      if (greatest > 253) continue;
      ASSERT_EQ(bars.counts.size(), static_cast<std::size_t>(greatest + 1));
      for (int n = 0; n <= greatest; ++n) {
        EXPECT_EQ(bars.counts[n], static_cast<std::uint64_t>(n + 1));
        EXPECT_NEAR(bars.first + n * bars.width, least + slope * static_cast<float>(n),
                    0.01 * slope);
      }
    }
  }
}

TEST(ViewHistogram, OtherValuesKeepTheirBinsAndRealGaps) {
  Histogram histogram(0.0, 1.0);
  for (int n = 0; n <= 1000; ++n) {
    const float value = 1e-3f * static_cast<float>(n);
    if (value < 0.1f || value > 0.2f) histogram.Add(value, 1);
  }
  const Histogram::Bars bars = histogram.bars();
  EXPECT_EQ(bars.counts, std::vector(histogram.counts().begin(), histogram.counts().end()));
  EXPECT_NEAR(bars.first, 0.5 * bars.width, 1e-12);
  EXPECT_NEAR(EmptyBars(histogram), 25, 2);
}

}  // namespace
}  // namespace palpate::view
