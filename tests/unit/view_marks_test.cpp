// What is written on pictures: scale bars, values and places, windows, distances.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "client/view/drawing/distances.h"
#include "client/view/drawing/readout.h"
#include "client/view/drawing/value_window.h"

namespace palpate::view {
namespace {

TEST(ViewScaleBar, IsTheLongestRoundLengthThatFits) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> exponent(-6.0, 6.0);
  for (int n = 0; n < 10000; ++n) {
    const double mm_per_px = std::pow(10.0, exponent(random));
    const double most_px = 20.0 + 200.0 * std::abs(std::sin(n));
    const ScaleBar bar = FitScaleBar(mm_per_px, most_px);
    EXPECT_NEAR(bar.length_px * mm_per_px, bar.length_mm, 1e-9 * bar.length_mm);
    EXPECT_LE(bar.length_px, most_px * (1.0 + 1e-9));
    // The next round length is at most 2.5 times as long.
    EXPECT_GT(2.5 * bar.length_px, most_px * (1.0 - 1e-9));
    const double digits =
        bar.length_mm / std::pow(10.0, std::floor(std::log10(bar.length_mm) + 1e-9));
    EXPECT_TRUE(std::abs(digits - 1) < 1e-9 || std::abs(digits - 2) < 1e-9 ||
                std::abs(digits - 5) < 1e-9)
        << bar.length_mm;
  }
}

TEST(ViewScaleBar, HasWordsAndNothingOfNothing) {
  EXPECT_EQ(TextOf(FitScaleBar(0.5, 140.0)), "50 mm");
  EXPECT_EQ(TextOf(FitScaleBar(0.0002, 140.0)), "0.02 mm");
  for (const double bad : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
    EXPECT_EQ(FitScaleBar(bad, 100.0).length_mm, 0.0);
  }
}

TEST(ViewReadout, PlacesHaveTheLettersOfTheirSides) {
  EXPECT_EQ(PlaceText({12.34, 4.5, 60.06}, true, {}), "L 12.3 P 4.5 S 60.1 mm");
  EXPECT_EQ(PlaceText({-12.34, -4.5, -60.06}, true, {}), "R 12.3 A 4.5 I 60.1 mm");
  EXPECT_EQ(PlaceText({-0.04, 0.0, 0.0}, true, {}), "L 0.0 P 0.0 S 0.0 mm");
  EXPECT_EQ(PlaceText({-0.04, -1.0, 2.0}, false, {}), "x 0.0 y -1.0 z 2.0 mm");
}

TEST(ViewReadout, ValuesHaveTheirUnit) {
  VolumeLattice lattice;
  lattice.type = LeafType::kInt16;
  lattice.unit = "HU";
  EXPECT_EQ(ValueText(-1024.0, lattice), "-1024 HU");
  EXPECT_EQ(ValueText(40.5678, lattice), "40.6 HU");
  EXPECT_EQ(ValueText(-0.01, lattice), "0 HU");
  lattice.unit.clear();
  lattice.type = LeafType::kFloat;
  EXPECT_EQ(ValueText(1.25e-7, lattice), "1.25e-07");
}

TEST(ViewReadout, WideWindowsHaveNoDecimalsAndNarrowOnesAllThatTheyNeed) {
  EXPECT_EQ(WindowText(614.5123, 359.0), "615");
  EXPECT_EQ(WindowText(-0.2, 359.0), "0");
  EXPECT_EQ(WindowText(0.0125, 0.05), "0.0125");
}

VolumeLattice LatticeOf(double min, double max, LeafType type, const char* unit) {
  VolumeLattice lattice;
  lattice.value_min = min;
  lattice.value_max = max;
  lattice.type = type;
  lattice.unit = unit;
  return lattice;
}

TEST(ViewValueWindow, HounsfieldUnitsAreToldByTheFileOrByTheValues) {
  EXPECT_TRUE(HasHounsfieldUnits(LatticeOf(0, 1, LeafType::kFloat, "HU")));
  EXPECT_TRUE(HasHounsfieldUnits(LatticeOf(-1024, 3071, LeafType::kInt16, "")));
  EXPECT_FALSE(HasHounsfieldUnits(LatticeOf(-1024, 3071, LeafType::kInt16, "mV")));
  EXPECT_FALSE(HasHounsfieldUnits(LatticeOf(0, 3071, LeafType::kInt16, "")));
  EXPECT_FALSE(HasHounsfieldUnits(LatticeOf(-32768, 32767, LeafType::kInt16, "")));
  EXPECT_FALSE(HasHounsfieldUnits(LatticeOf(-1024, 3071, LeafType::kFloat, "")));
}

TEST(ViewValueWindow, TheFirstWindowShowsSoftTissueInManyGreysAndOtherThingsWhole) {
  const ValueWindow first = FirstWindow(LatticeOf(-1024, 3071, LeafType::kInt16, "HU"));
  // Water, and brain 40 HU above it: at least ten of 256 greys apart. Bone is not water.
  EXPECT_GE(40.0 / first.width * 255.0, 10.0);
  EXPECT_LT(first.min(), -100.0);
  EXPECT_GT(first.max(), 500.0);
  const ValueWindow whole = FirstWindow(LatticeOf(3, 11, LeafType::kUint8, ""));
  EXPECT_EQ(whole.min(), 3.0);
  EXPECT_EQ(whole.max(), 11.0);
  EXPECT_GT(FirstWindow(LatticeOf(5, 5, LeafType::kUint8, "")).width, 0.0);
}

TEST(ViewValueWindow, TheWindowOfTheFileComesFirstUnlessItShowsNothing) {
  VolumeLattice lattice = LatticeOf(-1024, 3071, LeafType::kInt16, "HU");
  const ValueWindow other = FirstWindow(lattice);
  lattice.window_level = 700.0;
  lattice.window_width = 2600.0;
  EXPECT_EQ(FirstWindow(lattice), (ValueWindow{700.0, 2600.0}));
  for (const auto& [level, width] : {std::pair(9000.0, 100.0), {-5000.0, 10.0}, {700.0, NAN}}) {
    lattice.window_level = level;
    lattice.window_width = width;
    EXPECT_EQ(FirstWindow(lattice), other);
  }
}

TEST(ViewValueWindow, ADragWidensToTheRightRaisesUpAndStaysUsable) {
  const VolumeLattice lattice = LatticeOf(-1000, 3000, LeafType::kInt16, "HU");
  const ValueWindow start{40.0, 400.0};
  EXPECT_EQ(Dragged(start, 0, 0, 200, lattice), start);
  EXPECT_GT(Dragged(start, 10, 0, 200, lattice).width, start.width);
  EXPECT_EQ(Dragged(start, 10, 0, 200, lattice).level, start.level);
  EXPECT_NEAR(Dragged(start, 0, -50, 200, lattice).level, start.level + start.width, 1e-9);
  // There and back is where it was.
  const ValueWindow back = Dragged(Dragged(start, 30, -20, 200, lattice), -30, 0, 200, lattice);
  EXPECT_NEAR(back.width, start.width, 1e-9);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> px(-3000.0, 3000.0);
  ValueWindow window = start;
  for (int n = 0; n < 10000; ++n) {
    window = Dragged(window, px(random), px(random), 200, lattice);
    ASSERT_GT(window.max(), window.min());
    ASSERT_LE(std::abs(window.level), 20000.0);
  }
}

TEST(ViewDistances, TwoPointsAreADistanceAndTheLastIsRemovedFirst) {
  MeasureState measure;
  measure.AddPoint({0, 0, 0});
  EXPECT_TRUE(measure.distances.empty());
  measure.AddPoint({3, 4, 0});
  measure.AddPoint({1, 1, 1});
  measure.AddPoint({1, 1, 3});
  measure.AddPoint({9, 9, 9});
  ASSERT_EQ(measure.distances.size(), 2u);
  EXPECT_EQ(measure.distances[0].mm(), 5.0);
  EXPECT_EQ(TextOf(measure.distances[0]), "5.00 mm");
  EXPECT_EQ(TextOf({{0, 0, 0}, {0, 0, 123.456}}), "123.5 mm");
  EXPECT_EQ(TextOf({{0, 0, 0}, {0, 0, 0.0123}}), "0.012 mm");
  measure.RemoveLast();
  EXPECT_FALSE(measure.begun_W);
  EXPECT_EQ(measure.distances.size(), 2u);
  measure.Remove(7);
  measure.Remove(0);
  ASSERT_EQ(measure.distances.size(), 1u);
  EXPECT_EQ(measure.distances[0].mm(), 2.0);
  measure.RemoveLast();
  measure.RemoveLast();
  EXPECT_TRUE(measure.distances.empty());
}

TEST(ViewDistances, APointerFindsTheNearestEndWithinReach) {
  const auto appears = [](const Vec3& p) { return std::optional(Eigen::Vector2d(p.x(), p.y())); };
  std::vector<Distance> distances = {{Vec3(0, 0, 0), Vec3(100, 0, 0)},
                                     {Vec3(104, 0, 0), Vec3(200, 0, 0)}};
  const auto end = EndAt(distances, {101, 1}, 8.0, appears);
  ASSERT_TRUE(end);
  distances[end->number].*end->point = Vec3(7, 8, 9);
  EXPECT_EQ(distances[0].to_W, Vec3(7, 8, 9));
  EXPECT_EQ(EndAt(distances, {103, 1}, 8.0, appears)->number, 1u);
  EXPECT_FALSE(EndAt(distances, {50, 0}, 8.0, appears));
}

TEST(ViewDistances, APointerFindsTheNearestLineWithinReach) {
  const PixelOfPoint appears = [](const Vec3& p_W) -> std::optional<Eigen::Vector2d> {
    if (p_W.z() < 0.0) return std::nullopt;
    return Eigen::Vector2d(p_W.x(), p_W.y());
  };
  const std::vector<Distance> distances = {
      {{0, 0, 0}, {100, 0, 0}}, {{0, 10, 0}, {100, 10, 0}}, {{0, 5, -1}, {100, 5, 0}}};
  EXPECT_EQ(DistanceAt(distances, {50, 4}, 8.0, appears), 0u);
  EXPECT_EQ(DistanceAt(distances, {50, 6}, 8.0, appears), 1u);
  EXPECT_EQ(DistanceAt(distances, {50, 30}, 8.0, appears), std::nullopt);
  // Beside the ends.
  EXPECT_EQ(DistanceAt(distances, {-6, 0}, 8.0, appears), 0u);
  EXPECT_EQ(DistanceAt(distances, {-9, 0}, 8.0, appears), std::nullopt);
  EXPECT_EQ(PixelsToLine({3, 4}, {0, 0}, {0, 0}), 5.0);
}

}  // namespace
}  // namespace palpate::view
