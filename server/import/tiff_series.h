// Which files are the slices of a TIFF stack.
//
// Any thread; lists folders. Errors: palpate::Error without the folder's name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

bool IsTiffName(const std::filesystem::path& path);

// Whether most files of the folder are TIFF by their names.
bool IsTiffFolder(const std::filesystem::path& folder);

// All TIFF files of the folder by their numbers. Refuses several series, missing
// and double numbers.
std::vector<std::filesystem::path> TiffFolderSlices(const std::filesystem::path& folder);

// The slices of the series that starts with this file: all files of its folder
// whose names differ from its own in the last number only. The file alone when its
// name has no number.
std::vector<std::filesystem::path> TiffSeriesSlices(const std::filesystem::path& first);

}  // namespace palpate
