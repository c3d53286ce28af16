// Reads the header of a volume file and checks that all voxels are there, before they are read.
//
// Threads: any. Reads files; reads through compressed data without keeping them.
// Errors: palpate::Error without the file's name, see image_header.h.
#pragma once

#include <filesystem>
#include <string>

#include "server/import/image_header.h"

namespace palpate {

enum class ImageFormat { kNrrd, kMetaImage, kNifti };

// Throws kNotFound, kPermissionDenied, or kInvalidArgument if the path is no regular file.
void CheckReadable(const std::filesystem::path& path);

// Throws kPermissionDenied for a link that leads out of the allowed folders, and for a file of
// palpated's own.
void CheckPlace(const std::filesystem::path& file, const ImportLimits& limits);

// Throws kInvalidArgument (not this format, not supported, truncated, damaged) or kTooLarge. After
// the return, the file has voxels of this size, type and extent.
ImageHeader ReadCheckedHeader(const std::filesystem::path& path, ImageFormat format,
                              const ImportLimits& limits);

}  // namespace palpate
