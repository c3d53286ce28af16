#include "client/view/drawing/color_map.h"

#include <cmath>
#include <iterator>
#include <span>

namespace palpate::view {
namespace {

// A colour at a place of the map, 0 to 1. Colours between stops are interpolated linearly.
struct Stop {
  double at;
  std::array<double, 3> rgb;  // 0 to 255
};

constexpr Stop kGray[] = {{0.0, {0, 0, 0}}, {1.0, {255, 255, 255}}};
constexpr Stop kBone[] = {
    {0.0, {0, 0, 0}}, {0.375, {84, 84, 116}}, {0.75, {167, 199, 199}}, {1.0, {255, 255, 255}}};
constexpr Stop kHot[] = {
    {0.0, {0, 0, 0}}, {0.375, {255, 0, 0}}, {0.75, {255, 255, 0}}, {1.0, {255, 255, 255}}};
constexpr Stop kViridis[] = {
    {0.0, {68, 1, 84}},    {0.1, {72, 36, 117}},  {0.2, {65, 68, 135}},  {0.3, {53, 95, 141}},
    {0.4, {42, 120, 142}}, {0.5, {33, 145, 140}}, {0.6, {34, 168, 132}}, {0.7, {68, 191, 112}},
    {0.8, {122, 209, 81}}, {0.9, {189, 223, 38}}, {1.0, {253, 231, 37}},
};

// K. Moreland, "Diverging Color Maps for Scientific Visualization": equal steps on both sides of
// the middle look equal.
constexpr Stop kCoolWarm[] = {
    {0.0, {59, 76, 192}},     {0.125, {98, 130, 234}}, {0.25, {141, 176, 254}},
    {0.375, {184, 208, 249}}, {0.5, {221, 221, 221}},  {0.625, {245, 196, 173}},
    {0.75, {244, 154, 123}},  {0.875, {222, 96, 77}},  {1.0, {180, 4, 38}},
};

constexpr std::span<const Stop> kStops[] = {kGray, kBone, kHot, kViridis,
                                            kCoolWarm};  // by ColorMap
static_assert(std::size(kStops) == kColorMapNames.size());

}  // namespace

std::vector<std::uint8_t> ColorTable(ColorMap map) {
  const std::span<const Stop> stops = kStops[static_cast<std::size_t>(map)];
  std::vector<std::uint8_t> table;
  table.reserve(256 * 4);
  std::size_t next = 1;
  for (int entry = 0; entry < 256; ++entry) {
    const double at = entry / 255.0;
    while (stops[next].at < at) ++next;
    const Stop& below = stops[next - 1];
    const Stop& above = stops[next];
    const double share = (at - below.at) / (above.at - below.at);
    for (int channel = 0; channel < 3; ++channel) {
      const double value = std::lerp(below.rgb[channel], above.rgb[channel], share);
      table.push_back(static_cast<std::uint8_t>(std::lround(value)));
    }
    table.push_back(255);
  }
  return table;
}

}  // namespace palpate::view
