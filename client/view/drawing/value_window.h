// How values become colours: colour maps, and the window of the values that they show.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "common/bricks/volume_event.h"

namespace palpate::view {

enum class ColorMap : std::uint8_t { kGray, kBone, kHot, kViridis, kCoolWarm };

inline constexpr std::array<std::string_view, 5> kColorMapNames = {"gray", "bone", "hot", "viridis",
                                                                   "cool-warm"};

// Colour maps.
//
// 256 entries of red, green, blue, 255, from the least value to the greatest.
std::vector<std::uint8_t> ColorTable(ColorMap map);

// The window of the values: which of them the colour map's ends are, by level (its middle) and
// width.
//
// Values in data units. Threads: pure functions.
struct ValueWindow {
  double level = 0.0;
  double width = 1.0;  // above 0

  double min() const { return level - 0.5 * width; }
  double max() const { return level + 0.5 * width; }
  static ValueWindow Between(double min, double max) { return {0.5 * (min + max), max - min}; }
  friend bool operator==(const ValueWindow&, const ValueWindow&) = default;
};

struct WindowPreset {
  std::string_view name;
  ValueWindow window;
};
// For Hounsfield units.
inline constexpr std::array<WindowPreset, 5> kWindowPresets = {
    {{"Soft tissue and bone", {240.0, 800.0}},
     {"Bone", {400.0, 1800.0}},
     {"Soft tissue", {40.0, 400.0}},
     {"Lung", {-600.0, 1500.0}},
     {"Brain", {40.0, 80.0}}}};

// True if the file says so, or if it states no unit and its values look like it: whole numbers from
// that of air to that of bone.
bool HasHounsfieldUnits(const VolumeLattice& lattice);

ValueWindow WholeRange(const VolumeLattice& lattice);
// The window that the file proposes, if any.
std::optional<ValueWindow> WindowOfFile(const VolumeLattice& lattice);
// The window of a volume just loaded: the file's. Without one, soft tissue and bone at once for
// Hounsfield units, otherwise the whole range.
ValueWindow FirstWindow(const VolumeLattice& lattice);

// A drag over a slice: to the right widens, up raises the level, by the window's width over a drag
// of a quarter of `picture_px`. The result stays within some times the volume's range.
ValueWindow Dragged(const ValueWindow& window, double right_px, double down_px, double picture_px,
                    const VolumeLattice& lattice);

}  // namespace palpate::view
