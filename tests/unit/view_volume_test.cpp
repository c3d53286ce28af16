// The viewer's copy of a volume against a plain array that is changed alongside.
#include "client/view/volume/view_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <random>

#include "tests/support/view_volumes.h"

namespace palpate::view {
namespace {

using client::VolumeUpdate;

constexpr double kMin = -5.0, kMax = 27.0;

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

// Voxels one by one, and what follows from them by looking at all of them.
class Model {
 public:
  explicit Model(const Vec3i& size)
      : voxels_(testing::MakeVoxels(size, [](int, int, int) { return kMin; })) {}

  float Value(const Vec3i& v) const { return voxels_.At(v.x(), v.y(), v.z()); }
  // A brick as the daemon would send it after `change` of each of its voxels.
  template <typename Change>
  BrickPtr Set(const Vec3i& brick, const Change& change) {
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Vec3i v = brick * kBrickEdge + Vec3i(n >> 6, n >> 3 & 7, n & 7);
      if ((v.array() >= size().array()).any()) continue;
      const std::size_t at = (static_cast<std::size_t>(v.x()) * size().y() + v.y()) * size().z();
      float& value = voxels_.values[at + v.z()];
      value = change(v, value);
    }
    return testing::BrickOf(voxels_, brick);
  }
  void ExpectEqual(const ViewVolume& volume) const {
    std::array<std::uint64_t, Histogram::kBins> counts{};
    for (const float value : voxels_.values) {
      const double bin = (value - kMin) / (kMax - kMin) * Histogram::kBins;
      ++counts[static_cast<std::size_t>(std::clamp(bin, 0.0, Histogram::kBins - 1.0))];
    }
    ASSERT_EQ(volume.histogram().counts(), counts);
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
  void ExpectRanges(const ViewVolume& volume) const {
    const Vec3i count = volume.cell_brick_count();
    // Cells -1 .. size - 1 along each axis.
    ASSERT_EQ(count, (size().array() + 8).matrix() / 8);
    ASSERT_EQ(volume.cell_ranges().size(), static_cast<std::size_t>(count.prod()));
    for (int n = 0; n < count.prod(); ++n) {
      const Vec3i first = BrickWithNumber(n, count) * 8 - Vec3i::Ones();
      ValueRange range{std::numeric_limits<float>::max(), std::numeric_limits<float>::lowest()};
      for (int v = 0; v < 729; ++v) {
        const float value = Value(first + Vec3i(v / 81, v / 9 % 9, v % 9));
        range = {std::min(range.min, value), std::max(range.max, value)};
      }
      ASSERT_EQ(volume.cell_ranges()[n].min, range.min) << n;
      ASSERT_EQ(volume.cell_ranges()[n].max, range.max) << n;
    }
  }

  testing::VoxelArray voxels_;
};

// What a texture would hold that takes up nothing but the changes.
class Follower {
 public:
  void Take(ViewVolume& volume) {
    const VolumeChanges changes = volume.TakeChanges();
    ASSERT_TRUE(std::is_sorted(changes.bricks.begin(), changes.bricks.end(), std::less_equal<>()));
    if (changes.all) {
      Brick background;
      background.fill(static_cast<float>(kMin));
      bricks_.assign(volume.lattice() ? volume.lattice()->Bricks() : 0, background);
      const auto value = static_cast<float>(kMin);
      ranges_.assign(volume.cell_ranges().size(), {value, value});
      for (const std::uint64_t n : changes.bricks) ASSERT_NE(volume.At(n), background);
    }
    for (const std::uint64_t n : changes.bricks) {
      bricks_[n] = volume.At(n);
      TakeRangesAt(BrickWithNumber(n, volume.lattice()->BrickCounts()), volume);
    }
  }
  void ExpectEqual(const ViewVolume& volume) const {
    ASSERT_EQ(bricks_.size(), volume.lattice() ? volume.lattice()->Bricks() : 0);
    for (std::uint64_t n = 0; n < bricks_.size(); ++n) ASSERT_EQ(bricks_[n], volume.At(n)) << n;
    ASSERT_EQ(ranges_.size(), volume.cell_ranges().size());
    for (std::size_t n = 0; n < ranges_.size(); ++n) {
      ASSERT_EQ(ranges_[n].min, volume.cell_ranges()[n].min) << n;
      ASSERT_EQ(ranges_[n].max, volume.cell_ranges()[n].max) << n;
    }
  }

 private:
  // Of the cell bricks that have voxels of the brick among their corners.
  void TakeRangesAt(const Vec3i& brick, const ViewVolume& volume) {
    for (int n = 0; n < 8; ++n) {
      const Vec3i at = brick + Vec3i(n >> 2, n >> 1 & 1, n & 1);
      if ((at.array() >= volume.cell_brick_count().array()).any()) continue;
      const std::uint64_t number = BrickNumber(at, volume.cell_brick_count());
      ranges_[number] = volume.cell_ranges()[number];
    }
  }

  std::vector<Brick> bricks_;
  std::vector<ValueRange> ranges_;
};

Vec3i BrickOf(std::uint64_t number, const Vec3i& size) {
  return BrickWithNumber(number, Lattice(size).BrickCounts());
}

// Some bricks get new voxels: a few of them, all of them, one value, background.
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
    const float value = kind == 3 ? static_cast<float>(kMin) : uniform(random);
    update.bricks.push_back(
        {number, model.Set(BrickOf(number, model.size()), [&](const Vec3i&, float old) {
           if (kind == 0) return random() % 100 == 0 ? uniform(random) : old;
           return kind == 1 ? uniform(random) : value;
         })});
  }
  if (random() % 2 == 0) update.complete.emplace();
  update.bricks_left = update.complete ? 0 : random() % 5;
  return update;
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

TEST(ViewVolume, TheOverviewStandsInForBricksUntilTheyCome) {
  const Vec3i size(19, 8, 13);
  std::mt19937 random(3);
  Model model(size);
  ViewVolume volume;
  Follower follower;
  VolumeUpdate first = Beginning(size);
  const auto real = [&](const Vec3i& v, float) { return static_cast<float>(v.x() + v.z()); };
  first.bricks.push_back({2, model.Set(BrickOf(2, size), real)});
  volume.Take(first);
  model.ExpectEqual(volume);

  VolumeUpdate overview = Next(size);
  overview.overview_size = Vec3i(5, 2, 4);
  for (int n = 0; n < 40; ++n) overview.overview.push_back(static_cast<float>(n) * 0.5f);
  const auto stand_in = [&](const Vec3i& v, float) {
    return overview.overview[(v.x() / 4 * 2 + v.y() / 4) * 4 + v.z() / 4];
  };
  overview.bricks.push_back({4, model.Set(BrickOf(4, size), real)});
  overview.bricks_left = 3;
  for (const int n : {0, 1, 3, 5}) model.Set(BrickOf(n, size), stand_in);
  volume.Take(overview);
  model.ExpectEqual(volume);
  EXPECT_EQ(volume.bricks_left(), 3u);
  EXPECT_FALSE(volume.revision());
  follower.Take(volume);
  follower.ExpectEqual(volume);

  VolumeUpdate last = Next(size);
  last.bricks.push_back({1, model.Set(BrickOf(1, size), real)});
  volume.Take(last);
  model.ExpectEqual(volume);
  EXPECT_GT(volume.bricks_left(), 0u);  // not complete, whatever is known of the rest

  // Those that never came are background.
  VolumeUpdate complete = Next(size);
  complete.complete = VolumeRevision{7, 3};
  for (const int n : {0, 3, 5}) {
    model.Set(BrickOf(n, size), [](const Vec3i&, float) { return static_cast<float>(kMin); });
  }
  volume.Take(complete);
  model.ExpectEqual(volume);
  // Who did not look meanwhile is told of no brick that only seemed to be something.
  ViewVolume unseen;
  for (const VolumeUpdate& update : {first, overview, last, complete}) unseen.Take(update);
  EXPECT_EQ(unseen.TakeChanges().bricks, (std::vector<std::uint64_t>{1, 2, 4}));
  EXPECT_EQ(volume.bricks_left(), 0u);
  EXPECT_EQ(volume.revision(), complete.complete);
  follower.Take(volume);
  follower.ExpectEqual(volume);
}

TEST(ViewVolume, AnOverviewThatComesWithTheWholeVolumeIsNotShown) {
  const Vec3i size(8, 8, 16);
  Model model(size);
  ViewVolume volume;
  VolumeUpdate update = Beginning(size);
  update.overview_size = Vec3i(2, 2, 4);
  update.overview.assign(16, 3.0f);
  update.bricks.push_back({1, model.Set(Vec3i(0, 0, 1), [](auto&, float) { return 9.0f; })});
  update.complete.emplace();
  volume.Take(update);
  model.ExpectEqual(volume);
}

TEST(ViewVolume, AnUpdateWithoutALatticeIsAVoidVolume) {
  ViewVolume volume;
  EXPECT_FALSE(volume.lattice());
  volume.Take(Beginning(Vec3i(9, 9, 9)));
  VolumeUpdate placed = Next(Vec3i(9, 9, 9));
  placed.placement.emplace().X_DI.translation = Vec3(1, 2, 3);
  const std::uint64_t version = volume.version();
  volume.Take(placed);
  ASSERT_TRUE(volume.X_DI());
  EXPECT_EQ(volume.X_DI()->translation, Vec3(1, 2, 3));
  EXPECT_EQ(volume.version(), version);
  EXPECT_GT(volume.bricks_left(), 0u);
  volume.TakeChanges();
  // A change of one brick costs what it touches.
  Model model(Vec3i(9, 9, 9));
  VolumeUpdate edit = Next(model.size());
  edit.bricks.push_back({5, model.Set(Vec3i(1, 0, 1), [](auto&, float) { return 4.0f; })});
  volume.Take(edit);
  EXPECT_EQ(volume.TakeChanges().bricks, std::vector<std::uint64_t>{5});

  VolumeUpdate none;
  none.all = true;
  volume.Take(none);
  EXPECT_FALSE(volume.lattice() || volume.X_DI());
  EXPECT_EQ(volume.bricks_left(), 0u);
  EXPECT_EQ(volume.cell_brick_count(), Vec3i::Zero());
  EXPECT_TRUE(volume.cell_ranges().empty());
  EXPECT_EQ(volume.histogram().counts(), Histogram().counts());
  const VolumeChanges changes = volume.TakeChanges();
  EXPECT_TRUE(changes.all && changes.bricks.empty());
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
    update.bricks.push_back({n, model.Set(BrickOf(n, size), [&](const Vec3i& v, float) {
                               return static_cast<float>(f(v.cast<double>()));
                             })});
  }
  volume.Take(update);
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
