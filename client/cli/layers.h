// Layers of the settings as text, and from text.
//
// Values in data units, forces and lengths of the device. Pure; any thread.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "client/cli/json.h"
#include "client/sdk/settings.h"
#include "common/contract/render.h"

namespace palpate::cli {

// Skin over bone for CT in HU, as LayersOfList takes it.
inline constexpr std::string_view kSkinBone = "skin=-300,bone=300";

// A layer without an id, which the daemon gives. `holds`: firm, and nothing passes it; else soft,
// and the stylus passes it at 1 N.
SurfaceLayer NewLayer(const std::string& name, bool holds);

// Of "NAME=ISOVALUE,...", or of "skin-bone". The one with the greatest isovalue holds; the others
// are soft. `isovalue_of` gives an isovalue for its text. Errors: kInvalidArgument.
SurfaceLayers LayersOfList(const std::string& list,
                           const std::function<double(const std::string&)>& isovalue_of);

// "1 skin: isovalue -300, 0.3 N/mm, pops at 1 N"
std::string Describe(const SurfaceLayer& layer);
// Lines that end with \n; for none: that the one surface is felt.
std::string Describe(const SurfaceLayers& layers);

// What ToJson made of layers. Errors: kInvalidArgument.
SurfaceLayers LayersOfJson(const std::string& text);

}  // namespace palpate::cli
