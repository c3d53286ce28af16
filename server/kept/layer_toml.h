// Layers in TOML: tables with the fields of palpate.v1.SurfaceLayer, for palpated.toml and for the
// session's file.
//
// Threads: pure functions.
#pragma once

#include <toml++/toml.h>

#include "common/contract/render.h"

namespace palpate {

toml::array LayersToToml(const SurfaceLayers& layers);

// A layer without an id has 0, one without a stiffness that of the settings' default. Throws Error
// (kInvalidArgument) for what are no such tables.
SurfaceLayers LayersFromToml(const toml::node& node);

}  // namespace palpate
