#include "client/view/drawing/view_options.h"

#include <algorithm>

namespace palpate::view {

const Rgb& LayerColor(int id) {
  // Told apart by eyes without one of the three cones, too (after Okabe and Ito).
  static const std::array<Rgb, 8> colors = {Rgb{0.90f, 0.62f, 0.00f}, Rgb{0.34f, 0.71f, 0.91f},
                                            Rgb{0.00f, 0.62f, 0.45f}, Rgb{0.94f, 0.89f, 0.26f},
                                            Rgb{0.35f, 0.55f, 0.95f}, Rgb{0.84f, 0.37f, 0.00f},
                                            Rgb{0.80f, 0.47f, 0.65f}, Rgb{0.75f, 0.75f, 0.75f}};
  return colors[static_cast<std::size_t>(std::clamp(id, 1, 8) - 1)];
}

}  // namespace palpate::view
