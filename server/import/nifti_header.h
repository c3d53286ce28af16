// NIfTI headers in one file with the voxels ("n+1" of NIfTI-1, "n+2" of NIfTI-2),
// little and big endian.
//
// W is LPS, NIfTI is RAS: x and y change sign. The sform is used when it leads to
// the scanner's frame or there is no qform, else the qform; but never a sheared
// sform where there is a qform. Without either the axes are those of the index.
//
// Pure. Any thread. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string_view>

#include "server/import/image_header.h"

namespace palpate {

constexpr std::size_t kNifti1HeaderBytes = 348;
constexpr std::size_t kNifti2HeaderBytes = 540;
constexpr std::size_t kLongestNiftiHeader = kNifti2HeaderBytes;

// `head`: the first bytes of the (inflated) file, kLongestNiftiHeader or all.
ImageHeader ParseNiftiHeader(std::string_view head);

}  // namespace palpate
