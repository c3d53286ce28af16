// Files that hold only voxels. The caller describes the voxels in place of a header.
//
// Threads: any. Reads the file's size. Errors: palpate::Error, see image_header.h.
#pragma once

#include <filesystem>

#include "server/import/image_header.h"
#include "server/volume/load/raw_voxels.h"

namespace palpate {

// Refuses a file whose size differs from the sum of the offset and the voxels.
ImageHeader CheckedRawHeader(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits);

}  // namespace palpate
