// Isovalues that a volume suggests, on volumes whose classes of values are known.
#include "server/volume/load/suggested_isovalues.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>
#include <string>

#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr int kEdge = 44;  // no multiple of a brick's edge: voxels beyond the lattice do not count

// A ball of radius 15 in a cube.
bool IsInBall(int i, int j, int k) {
  const Vec3 p = Vec3(i, j, k) - Vec3::Constant(21.5);
  return p.norm() < 15.0;
}

VolumeSnapshot Made(const std::function<double(int, int, int)>& value, const std::string& unit = {},
                    bool is_level_set = false) {
  const auto made = testing::MakeVolume(Vec3i::Constant(kEdge), value);
  VolumeMetadata metadata = made->metadata();
  metadata.unit = unit;
  metadata.is_level_set = is_level_set;
  return {metadata, made->bricks(), 1, 1};
}

std::string NamesOf(const VolumeValues& values) {
  std::string names;
  for (const SuggestedIsovalue& suggested : values.suggested) names += suggested.name + " ";
  return names;
}

TEST(SuggestedIsovalues, OtsuLiesBetweenTwoNoisyClasses) {
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0.0, 6.0);
  const VolumeValues values = ValuesOf(Made([&](int i, int j, int k) {
    return std::round((IsInBall(i, j, k) ? 180.0 : 60.0) + noise(random));
  }));
  EXPECT_EQ(NamesOf(values), "otsu ");
  EXPECT_GT(values.suggested[0].isovalue, 85.0);
  EXPECT_LT(values.suggested[0].isovalue, 155.0);
  ASSERT_EQ(values.histogram.peaks.size(), 2u);
  EXPECT_NEAR(values.histogram.peaks[0], 60.0, 4.0);
  EXPECT_NEAR(values.histogram.peaks[1], 180.0, 4.0);
}

// With the background, the threshold would lie between it and both tissues.
TEST(SuggestedIsovalues, TheBackgroundIsNoClass) {
  std::mt19937 random(2);
  std::normal_distribution<double> noise(0.0, 3.0);
  const VolumeValues values = ValuesOf(Made([&](int i, int j, int k) {
    return IsInBall(i, j, k) ? std::round((i < 22 ? 120.0 : 200.0) + noise(random)) : 0.0;
  }));
  EXPECT_GT(values.suggested[0].isovalue, 130.0);
  EXPECT_LT(values.suggested[0].isovalue, 190.0);
  EXPECT_EQ(values.histogram.peaks.size(), 2u);
}

TEST(SuggestedIsovalues, OfTwoValuesTheMiddle) {
  const VolumeValues values =
      ValuesOf(Made([](int i, int j, int k) { return IsInBall(i, j, k) ? 7.0 : 3.0; }));
  EXPECT_EQ(values.suggested[0].isovalue, 5.0);
  EXPECT_EQ(values.histogram.counts.size(), 5u);
  EXPECT_EQ(std::accumulate(values.histogram.counts.begin(), values.histogram.counts.end(),
                            std::uint64_t{0}),
            static_cast<std::uint64_t>(kEdge) * kEdge * kEdge);
  EXPECT_EQ(values.histogram.counts[1] + values.histogram.counts[2] + values.histogram.counts[3],
            0u);
}

// Noise in the 256 bins of the range would all fall into one of them.
TEST(SuggestedIsovalues, OneOutlierDoesNotHideTheRest) {
  const VolumeValues values = ValuesOf(Made([](int i, int j, int k) {
    if (i == 5 && j == 5 && k == 5) return 1e30;
    return IsInBall(i, j, k) ? 0.75 + 0.001 * (i % 7) : 0.25 + 0.001 * (j % 5);
  }));
  EXPECT_GT(values.suggested[0].isovalue, 0.26);
  EXPECT_LE(values.suggested[0].isovalue, 0.75);
  EXPECT_LT(values.histogram.high, 1.0);
}

TEST(SuggestedIsovalues, CtStartsAtBone) {
  const auto head = [](double inner) {
    return [inner](int i, int j, int k) {
      const double r = (Vec3(i, j, k) - Vec3::Constant(21.5)).norm();
      return r > 18.0 ? -1000.0 : r > 15.0 ? 40.0 : inner;
    };
  };
  EXPECT_EQ(NamesOf(ValuesOf(Made(head(900.0), "HU"))), "bone skin otsu ");
  EXPECT_EQ(ValuesOf(Made(head(900.0), "HU")).suggested[0].isovalue, 300.0);
  EXPECT_EQ(ValuesOf(Made(head(900.0), "HU")).suggested[1].isovalue, -300.0);
  EXPECT_EQ(NamesOf(ValuesOf(Made(head(120.0), "HU"))), "skin otsu ");  // there is no bone
  EXPECT_EQ(NamesOf(ValuesOf(Made(head(900.0), "K"))), "otsu ");
  // A few voxels of metal are no bone.
  EXPECT_EQ(NamesOf(ValuesOf(Made(
                [&](int i, int j, int k) {
                  return i == 20 && j == 20 && k < 5 ? 3000.0 : head(120.0)(i, j, k);
                },
                "HU"))),
            "skin otsu ");
}

// 1024: a CT that lost its rescale. Air at -1000 makes Hounsfield units likely, but no more.
TEST(SuggestedIsovalues, WithoutAUnitNoValueIsCalledBone) {
  const auto head = [](double shift) {
    return ValuesOf(Made([shift](int i, int j, int k) {
      const double r = (Vec3(i, j, k) - Vec3::Constant(21.5)).norm();
      return shift + (r > 18.0 ? -1000.0 + (i + j) % 5 : r > 15.0 ? 40.0 : 900.0);
    }));
  };
  EXPECT_EQ(NamesOf(head(1024.0)), "otsu ");
  const VolumeValues likely = head(0.0);
  EXPECT_EQ(NamesOf(likely), "otsu bone skin ");
  EXPECT_NE(likely.suggested[1].reason.find("if "), std::string::npos);
}

// Outside of a round field of view.
TEST(SuggestedIsovalues, PaddingOfCtCountsAsItsLeastValue) {
  const auto scan = [](double padding, const std::string& unit = "") {
    return ValuesOf(Made(
        [padding](int i, int j, int k) {
          const double r = (Vec3(i, j, k) - Vec3::Constant(21.5)).norm();
          if (std::hypot(i - 21.5, j - 21.5) > 21.0) return padding;
          if (i == 22 && j == 22 && k == 1) return -1032.0;  // noise
          return r > 15.0 ? -1000.0 + (i + j) % 5 : r > 8.0 ? 40.0 + (i + k) % 7 : 900.0;
        },
        unit));
  };
  for (const std::string unit : {"", "HU"}) {
    const VolumeValues plain = scan(-1024.0, unit);
    EXPECT_FALSE(plain.has_padding);
    EXPECT_EQ(NamesOf(plain), unit.empty() ? "otsu bone skin " : "bone skin otsu ");
    for (const double padding : {-1025.0, -2000.0, -3024.0, -32768.0}) {
      const VolumeValues padded = scan(padding, unit);
      EXPECT_TRUE(padded.has_padding);
      EXPECT_EQ(NamesOf(padded), NamesOf(plain));
      EXPECT_EQ(padded.suggested[0].isovalue, plain.suggested[0].isovalue);
      EXPECT_EQ(padded.histogram, plain.histogram);
    }
  }
  // Inside of the volume, or in what is no CT, such values are values.
  EXPECT_FALSE(scan(-3024.0, "K").has_padding);
  const auto inside = [](double outside) {
    return ValuesOf(Made(
        [outside](int i, int j, int k) { return IsInBall(i, j, k) ? -3024.0 + i : outside + j; }));
  };
  EXPECT_FALSE(inside(-1000.0).has_padding);
  EXPECT_FALSE(inside(-9000.0).has_padding);
}

// Air of one value is no background that a program has cut away.
TEST(SuggestedIsovalues, AirOfCtIsAClass) {
  const VolumeValues values = ValuesOf(Made(
      [](int i, int j, int k) { return IsInBall(i, j, k) ? 30.0 + (i + k) % 40 : -1000.0; }, "HU"));
  EXPECT_EQ(values.suggested.back().name, "otsu");
  EXPECT_NEAR(values.suggested.back().isovalue, -480.0, 100.0);
}

TEST(SuggestedIsovalues, SurfacesThatAreKnown) {
  const auto distance = [](int i, int j, int k) {
    return std::clamp((Vec3(i, j, k) - Vec3::Constant(21.5)).norm() - 15.0, -3.0, 3.0);
  };
  const VolumeValues level_set = ValuesOf(Made(distance, "", true));
  EXPECT_EQ(NamesOf(level_set), "surface ");
  EXPECT_EQ(level_set.suggested[0].isovalue, 0.0);
  const BuiltinVolume bumps = MakeBuiltin("builtin:bumps:32");
  const VolumeValues builtin = ValuesOf(*MakeSnapshot(bumps.grid, bumps.metadata, 1));
  EXPECT_EQ(builtin.suggested[0].name, "surface");
  EXPECT_EQ(builtin.suggested[0].isovalue, 0.5);
}

// Bricks of one value are counted without a look at their voxels.
TEST(SuggestedIsovalues, ConstantBricksCountAsTheirVoxels) {
  const LeafPtr low = Leaf::Constant(LeafType::kFloat, 0.0f);
  const LeafPtr high = Leaf::Constant(LeafType::kFloat, 10.0f);
  const auto volume = testing::VolumeOfLeaves(
      Vec3i(20, 8, 8), [&](const Vec3i& brick) { return brick.x() == 2 ? high : low; }, 0.0, 10.0);
  const VolumeValues values = ValuesOf(*volume);
  EXPECT_EQ(values.histogram.counts.front(), 16u * 64u);
  EXPECT_EQ(values.histogram.counts.back(), 4u * 64u);
}

}  // namespace
}  // namespace palpate
