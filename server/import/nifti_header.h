// Parses NIfTI headers that are in one file with the voxels ("n+1" of NIfTI-1, "n+2" of NIfTI-2),
// little and big endian.
//
// W is LPS and NIfTI is RAS, so x and y change their sign. The sform is used if it leads to the
// scanner's frame or if there is no qform; otherwise the qform is used. A sheared sform is never
// used if there is a qform. Without both, the axes are those of the index.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string_view>

#include "server/import/image_header.h"

namespace palpate {

constexpr std::size_t kNifti1HeaderBytes = 348;
constexpr std::size_t kNifti2HeaderBytes = 540;
constexpr std::size_t kLongestNiftiHeader = kNifti2HeaderBytes;

// `head`: the first bytes of the (inflated) file: kLongestNiftiHeader bytes, or all of the file.
ImageHeader ParseNiftiHeader(std::string_view head);

}  // namespace palpate
