// Layers for tests of the renderer, and the bands between them as a judge sees them.
#pragma once

#include <algorithm>
#include <initializer_list>

#include "server/haptics/haptic_surface.h"

namespace palpate::testing {

inline HapticLayers LayersOf(std::initializer_list<HapticLayer> list) {
  HapticLayers layers;
  for (const HapticLayer& layer : list)
    layers.layer[static_cast<std::size_t>(layers.count++)] = layer;
  return layers;
}

// The free space of a stylus that has passed so many layers.
inline HapticSurface BandOf(HapticSurface surface, int passed) {
  const HapticLayers& layers = *surface.layers;
  const auto isovalue = [&](int n) { return layers.layer[static_cast<std::size_t>(n)].isovalue; };
  surface.lower = passed > 0 ? isovalue(passed - 1) : -kUnbounded;
  surface.isovalue = passed < layers.count ? isovalue(passed) : kUnbounded;
  return surface;
}

}  // namespace palpate::testing
