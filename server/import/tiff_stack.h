// Reads TIFF stacks with libtiff: one file of several pages, or one file per slice. Grey, strips or
// tiles, any compression that libtiff knows. Values are used as they are stored, also if 0 means
// white.
//
// Threads: one. Reads files. Errors: palpate::Error without the input's name.
#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "server/import/image_header.h"
#include "server/import/voxel_reader.h"

namespace palpate {

struct TiffStack {
  std::vector<std::filesystem::path> files;  // files of one page each, or one file with all pages
  std::vector<std::uint32_t> pages;          // of the one file, in the order of slices
  ImageHeader header;                        // size and type of the whole stack
  bool states_spacing = false;               // in header.geometry
  bool has_one_page = false;  // of ImageJ: the other slices follow the first one's data
};

// Reads the headers of all slices of a file or folder. Checks that the slices make a volume, that
// the volume is within the limits, and that the data are there.
TiffStack OpenTiffStack(const std::filesystem::path& input, const ImportLimits& limits);

// Calls `progress` with the fraction of slices read so far.
void ReadTiffVoxels(const TiffStack& stack, const std::function<void(double)>& progress,
                    const VoxelSink& sink);

// By the ending.
bool IsTiffName(const std::filesystem::path& path);

// True if most files of the folder are TIFF by name.
bool IsTiffFolder(const std::filesystem::path& folder);

}  // namespace palpate
