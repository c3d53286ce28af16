// Files that hold nothing but voxels: what was said of them in place of a header.
//
// Any thread; looks at the file's size. Errors: palpate::Error, see image_header.h.
#pragma once

#include <filesystem>

#include "server/import/image_header.h"
#include "server/volume/raw_voxels.h"

namespace palpate {

// Refuses a file whose size is not that of the offset and the voxels.
ImageHeader CheckedRawHeader(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits);

}  // namespace palpate
