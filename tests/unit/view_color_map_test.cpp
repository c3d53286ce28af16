#include "client/view/drawing/value_window.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate::view {
namespace {

using Color = std::array<int, 3>;

Color Entry(const std::vector<std::uint8_t>& table, int entry) {
  return {table[4 * entry], table[4 * entry + 1], table[4 * entry + 2]};
}

// Relative luminance of an sRGB colour, 0 to 1.
double Luminance(const Color& color) {
  const auto linear = [](int value) {
    const double share = value / 255.0;
    return share <= 0.04045 ? share / 12.92 : std::pow((share + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(color[0]) + 0.7152 * linear(color[1]) + 0.0722 * linear(color[2]);
}

constexpr std::array kAllMaps = {ColorMap::kGray, ColorMap::kBone, ColorMap::kHot,
                                 ColorMap::kViridis, ColorMap::kCoolWarm};

TEST(ViewColorMap, EveryMapHasANameAnd256OpaqueEntriesNearTheirNeighbours) {
  ASSERT_EQ(kColorMapNames.size(), kAllMaps.size());
  for (const ColorMap map : kAllMaps) {
    const auto table = ColorTable(map);
    ASSERT_EQ(table.size(), 256u * 4u);
    for (int entry = 0; entry < 256; ++entry) EXPECT_EQ(table[4 * entry + 3], 255);
    for (int n = 4; n < 4 * 256; ++n) {
      EXPECT_NEAR(table[n], table[n - 4], 4) << kColorMapNames[static_cast<int>(map)] << " " << n;
    }
  }
}

TEST(ViewColorMap, EndsAreThoseOfTheMap) {
  struct Ends {
    ColorMap map;
    Color first, last;
  };
  const Color black = {0, 0, 0}, white = {255, 255, 255};
  for (const auto& [map, first, last] :
       {Ends{ColorMap::kGray, black, white}, Ends{ColorMap::kBone, black, white},
        Ends{ColorMap::kHot, black, white}, Ends{ColorMap::kViridis, {68, 1, 84}, {253, 231, 37}},
        Ends{ColorMap::kCoolWarm, {59, 76, 192}, {180, 4, 38}}}) {
    EXPECT_EQ(Entry(ColorTable(map), 0), first);
    EXPECT_EQ(Entry(ColorTable(map), 255), last);
  }
  for (int n = 0; n < 256; ++n) EXPECT_EQ(Entry(ColorTable(ColorMap::kGray), n), (Color{n, n, n}));
}

// Also the two branches of kCoolWarm, which is brightest in the middle.
TEST(ViewColorMap, LuminanceRisesWhereAMapIsReadAsAnAmount) {
  for (const ColorMap map : kAllMaps) {
    const bool is_diverging = map == ColorMap::kCoolWarm;
    const auto table = ColorTable(map);
    for (int entry = 8; entry < 256; ++entry) {
      if (is_diverging && entry > 120 && entry < 136 + 8) continue;
      const double rise = Luminance(Entry(table, entry)) - Luminance(Entry(table, entry - 8));
      EXPECT_GT(is_diverging && entry > 128 ? -rise : rise, 0.0)
          << kColorMapNames[static_cast<int>(map)] << " " << entry;
    }
  }
}

}  // namespace
}  // namespace palpate::view
