// The settings of a scene that clients may change.
//
// Threads: a plain value.
#pragma once

#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"

namespace palpate {

struct RenderSettings {
  double isovalue = 0.0;             // data units
  double normalized_isovalue = 0.5;  // the same isovalue over the volume's range, 0 to 1
  HapticSettings haptics{};
};

}  // namespace palpate
