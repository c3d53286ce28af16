// Colour maps.
//
// Threads: pure.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

namespace palpate::view {

enum class ColorMap : std::uint8_t { kGray, kBone, kHot, kViridis, kCoolWarm };

inline constexpr std::array<std::string_view, 5> kColorMapNames = {"gray", "bone", "hot", "viridis",
                                                                   "cool-warm"};

// 256 entries of red, green, blue, 255, from the least value to the greatest.
std::vector<std::uint8_t> ColorTable(ColorMap map);

}  // namespace palpate::view
