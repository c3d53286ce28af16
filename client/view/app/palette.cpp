#include "client/view/app/palette.h"

#include <algorithm>
#include <cmath>

namespace palpate::view {
namespace {

constexpr Palette kDarkPalette = {
    .ground = {0.11f, 0.12f, 0.14f},
    .field = {0.17f, 0.20f, 0.25f},
    .histogram = {0.08f, 0.09f, 0.10f},
    .header = {0.20f, 0.24f, 0.30f},
    .popup = {0.09f, 0.10f, 0.12f},
    .message = {0.06f, 0.07f, 0.08f, 0.86f},
    .button = {0.17f, 0.31f, 0.475f},
    .hovered = {0.22f, 0.40f, 0.60f},
    .active = {0.10f, 0.42f, 0.72f},
    .text = {1.0f, 1.0f, 1.0f},
    .dim = {0.68f, 0.72f, 0.78f},
    .good = {0.35f, 0.80f, 0.45f},
    .warning = {1.00f, 0.72f, 0.25f},
    .bad = {1.00f, 0.55f, 0.50f},
    .suggestion = {0.55f, 0.75f, 1.00f},
    .isovalue = {1.00f, 0.92f, 0.47f},
    .material = {0.78f, 0.71f, 0.59f},
    .other_bars = {0.36f, 0.40f, 0.46f},
    .line = {0.75f, 0.80f, 0.86f},
};

constexpr Palette kLightPalette = {
    .ground = {0.95f, 0.95f, 0.96f},
    .field = {0.87f, 0.88f, 0.90f},
    .histogram = {1.0f, 1.0f, 1.0f},
    .header = {0.80f, 0.84f, 0.90f},
    .popup = {1.00f, 1.00f, 1.00f},
    .message = {1.00f, 1.00f, 1.00f, 0.90f},
    .button = {0.70f, 0.80f, 0.93f},
    .hovered = {0.58f, 0.74f, 0.94f},
    .active = {0.45f, 0.68f, 0.96f},
    .text = {0.05f, 0.06f, 0.08f},
    .dim = {0.27f, 0.30f, 0.34f},
    .good = {0.02f, 0.33f, 0.12f},
    .warning = {0.45f, 0.25f, 0.00f},
    .bad = {0.62f, 0.05f, 0.05f},
    .suggestion = {0.05f, 0.25f, 0.60f},
    .isovalue = {0.75f, 0.35f, 0.00f},
    .material = {0.62f, 0.52f, 0.38f},
    .other_bars = {0.68f, 0.71f, 0.75f},
    .line = {0.15f, 0.25f, 0.40f},
};

double Luminance(const Rgba& color) {
  const auto linear = [](float channel) {
    const auto c = static_cast<double>(channel);
    return c <= 0.03928 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(color.r) + 0.7152 * linear(color.g) + 0.0722 * linear(color.b);
}

}  // namespace

const Palette& PaletteOf(Theme theme) {
  return theme == Theme::kLight ? kLightPalette : kDarkPalette;
}

double ContrastOf(const Rgba& a, const Rgba& b) {
  const auto [dark, bright] = std::minmax({Luminance(a), Luminance(b)});
  return (bright + 0.05) / (dark + 0.05);
}

}  // namespace palpate::view
