// Finds the files that are the slices of a TIFF stack.
//
// Threads: any. Lists folders. Errors: palpate::Error without the folder's name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

bool IsTiffName(const std::filesystem::path& path);

// True if most files of the folder are TIFF by name.
bool IsTiffFolder(const std::filesystem::path& folder);

// Returns all TIFF files of the folder, ordered by number. Refuses several series, missing numbers
// and double numbers.
std::vector<std::filesystem::path> TiffFolderSlices(const std::filesystem::path& folder);

// Returns the slices of the series that starts with this file: all files of its folder whose names
// differ only in the last number. Returns only this file if its name has no number.
std::vector<std::filesystem::path> TiffSeriesSlices(const std::filesystem::path& first);

}  // namespace palpate
