// What clients set of a scene.
//
// Threads: a plain value.
#pragma once

#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"

namespace palpate {

struct RenderSettings {
  double isovalue = 0.0;             // data units
  double normalized_isovalue = 0.5;  // the same
  HapticSettings haptics{};
  DecompositionMethod method = DecompositionMethod::kTpbcc;
};

}  // namespace palpate
