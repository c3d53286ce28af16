// Parses NRRD headers (teem's format definition, NRRD0001 to NRRD0005): attached and detached,
// encodings raw and gzip, one data file.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string_view>

#include "server/import/image_header.h"

namespace palpate {

// `head`: the first bytes of the file, at least up to the end of the header.
// `whole`: `head` is the whole file. `spacing_is_given`: the header's spacing does not matter.
ImageHeader ParseNrrdHeader(std::string_view head, bool whole, bool spacing_is_given = false);

}  // namespace palpate
