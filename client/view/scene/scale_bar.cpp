#include "client/view/scene/scale_bar.h"

#include <fmt/core.h>

#include <cmath>

namespace palpate::view {

ScaleBar FitScaleBar(double mm_per_px, double most_px) {
  const double most_mm = mm_per_px * most_px;
  if (!(most_mm > 0.0) || !std::isfinite(most_mm)) return {};
  const double power = std::pow(10.0, std::floor(std::log10(most_mm)));
  double length_mm = power;
  for (const double times : {2.0, 5.0}) {
    if (times * power <= most_mm) length_mm = times * power;
  }
  return {length_mm, length_mm / mm_per_px};
}

std::string TextOf(const ScaleBar& bar) { return fmt::format("{:.6g} mm", bar.length_mm); }

}  // namespace palpate::view
