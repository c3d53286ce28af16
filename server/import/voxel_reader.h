// Reads the voxels of one frame as floats.
//
// Threads: one. Reads files. Errors: palpate::Error without the file's name.
#pragma once

#include <filesystem>
#include <memory>

#include "server/import/image_header.h"

namespace palpate {

// Converts `count` voxels at `bytes` to floats at `out`, with the header's type, byte order, slope
// and intercept.
void DecodeVoxels(const char* bytes, std::size_t count, const ImageHeader& header, float* out);

// Reads a file that ReadCheckedHeader() accepted with this header. `frame` must exist. Memory: the
// floats and a small buffer. Refuses a file that has changed since the check.
std::unique_ptr<float[]> ReadVoxels(const std::filesystem::path& path, const ImageHeader& header,
                                    std::int64_t frame);

}  // namespace palpate
