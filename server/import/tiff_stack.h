// TIFF stacks through libtiff: one file of several pages, or one file per slice.
// Grey, strips or tiles, any compression that libtiff knows. Values are taken as they
// are stored, also where 0 means white.
//
// One thread; reads files. Errors: palpate::Error without the input's name.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "server/import/image_header.h"

namespace palpate {

struct TiffStack {
  std::vector<std::filesystem::path> files;  // of one page each, or one file of all pages
  std::vector<std::uint32_t> pages;          // of the one file; reduced images are left out
  ImageHeader header;                        // size and type of the whole
};

// Reads the headers of all slices of a file or folder and checks that they make a
// volume, lie within the limits and that their data are there.
TiffStack OpenTiffStack(const std::filesystem::path& input, const ImportLimits& limits);

// `progress` is told the fraction of slices that have been read.
std::unique_ptr<float[]> ReadTiffVoxels(const TiffStack& stack,
                                        const std::function<void(double)>& progress);

}  // namespace palpate
