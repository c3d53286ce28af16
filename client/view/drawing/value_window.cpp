#include "client/view/drawing/value_window.h"

#include <algorithm>
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

namespace {

constexpr double kAir_HU = -900.0;
constexpr double kLeastOfAScanner = -4096.0;
constexpr double kBone_HU = 300.0;
// Of the volume's range.
constexpr double kNarrowest = 1e-3;
constexpr double kWidest = 4.0;

}  // namespace

bool HasHounsfieldUnits(const VolumeLattice& lattice) {
  if (!lattice.unit.empty()) return lattice.unit == "HU";
  return lattice.type == LeafType::kInt16 && lattice.value_min <= kAir_HU &&
         lattice.value_min >= kLeastOfAScanner && lattice.value_max >= kBone_HU;
}

ValueWindow WholeRange(const VolumeLattice& lattice) {
  const ValueWindow whole = ValueWindow::Between(lattice.value_min, lattice.value_max);
  return whole.width > 0.0 ? whole : ValueWindow{whole.level, 1.0};
}

std::optional<ValueWindow> WindowOfFile(const VolumeLattice& lattice) {
  const ValueWindow window{lattice.window_level, lattice.window_width};
  const bool is_one = std::isfinite(window.level) && std::isfinite(window.width) &&
                      window.width > 0.0 && window.max() > lattice.value_min &&
                      window.min() < lattice.value_max;
  return is_one ? std::optional(window) : std::nullopt;
}

ValueWindow FirstWindow(const VolumeLattice& lattice) {
  if (const auto of_file = WindowOfFile(lattice)) return *of_file;
  return HasHounsfieldUnits(lattice) ? kWindowPresets[0].window : WholeRange(lattice);
}

ValueWindow Dragged(const ValueWindow& window, double right_px, double down_px, double picture_px,
                    const VolumeLattice& lattice) {
  const ValueWindow whole = WholeRange(lattice);
  const double widths_per_px = 4.0 / std::max(picture_px, 1.0);
  return {.level = std::clamp(window.level - down_px * widths_per_px * window.width,
                              whole.level - whole.width, whole.level + whole.width),
          .width = std::clamp(window.width * std::exp(right_px * widths_per_px),
                              kNarrowest * whole.width, kWidest * whole.width)};
}

}  // namespace palpate::view
