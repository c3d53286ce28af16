// Reads the header of a volume file and checks that all its voxels are there,
// before ITK opens it.
//
// Any thread; reads files, streams through compressed data without keeping them.
// Errors: palpate::Error without the file's name, see image_header.h.
#pragma once

#include <filesystem>
#include <string>

#include "server/import/image_header.h"

namespace palpate {

enum class ImageFormat { kNrrd, kMetaImage, kNifti };

// kNotFound, kPermissionDenied, or kInvalidArgument for what is no regular file.
void CheckReadable(const std::filesystem::path& path);

// kPermissionDenied for a link that leads out of the folders that files may be read from, and for a
// file of palpated's own.
void CheckPlace(const std::filesystem::path& file, const ImportLimits& limits);

// Throws kInvalidArgument (not this format, not supported, truncated, damaged) or
// kTooLarge. Unless it throws, size, type and extent of the voxels are as told.
ImageHeader ReadCheckedHeader(const std::filesystem::path& path, ImageFormat format,
                              const ImportLimits& limits);

}  // namespace palpate
