// NIfTI-1 headers of single files (.nii), little and big endian.
//
// Pure. Any thread. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string_view>

#include "server/import/image_header.h"

namespace palpate {

constexpr std::size_t kNiftiHeaderBytes = 348;

// `head`: the first bytes of the (inflated) file, kNiftiHeaderBytes or more.
ImageHeader ParseNiftiHeader(std::string_view head);

}  // namespace palpate
