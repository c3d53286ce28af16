// Reads the voxels of one frame as floats.
//
// One thread; reads files. Errors: palpate::Error without the file's name.
#pragma once

#include <filesystem>
#include <memory>

#include "server/import/image_header.h"

namespace palpate {

// `count` voxels of the header's type, byte
// order, slope and intercept at `bytes` become floats at `out`.
void DecodeVoxels(const char* bytes, std::size_t count, const ImageHeader& header, float* out);

// Of a file that ReadCheckedHeader() accepted with this header, `frame` one that it
// has. Memory: the floats and a small buffer. Refuses a file that has changed since.
std::unique_ptr<float[]> ReadVoxels(const std::filesystem::path& path, const ImageHeader& header,
                                    std::int64_t frame);

}  // namespace palpate
