// Parses MetaImage headers (.mha with the voxels after the header, .mhd with a data file).
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string_view>

#include "server/import/image_header.h"

namespace palpate {

// `head`: the first bytes of the file, at least up to the line ElementDataFile. `spacing_is_given`:
// the header's spacing does not matter.
ImageHeader ParseMetaImageHeader(std::string_view head, bool spacing_is_given = false);

}  // namespace palpate
