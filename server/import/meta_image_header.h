// MetaImage headers (.mha with the voxels behind them, .mhd with a data file).
//
// Pure. Any thread. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string_view>

#include "server/import/image_header.h"

namespace palpate {

// `head`: the first bytes of the file, at least up to the line ElementDataFile.
ImageHeader ParseMetaImageHeader(std::string_view head);

}  // namespace palpate
