#include "client/view/drawing/value_window.h"

#include <algorithm>
#include <cmath>

namespace palpate::view {
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
