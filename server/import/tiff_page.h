// One page of a TIFF file through libtiff, grey, in strips or tiles.
//
// One thread; reads files. Errors: palpate::Error without the file's name.
#pragma once

#include <tiffio.h>

#include <filesystem>
#include <memory>

#include "server/import/image_header.h"

namespace palpate {

struct TiffCloser {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffFile = std::unique_ptr<TIFF, TiffCloser>;

// Opens a file at its first page. libtiff's own messages are dropped.
TiffFile OpenTiff(const std::filesystem::path& path);

// Size along x and y and type of the page that the file is at. Refuses colour, odd
// types, absurd tiles, and data that lie beyond the file's end.
struct TiffPage {
  std::int64_t width = 0;
  std::int64_t height = 0;
  ScalarType type = ScalarType::kUint8;

  bool operator==(const TiffPage&) const = default;
};
TiffPage CheckTiffPage(TIFF* tiff);

// Whether the page is a smaller copy or a mask of another one.
bool IsAuxiliaryPage(TIFF* tiff);

// Reads the page that the file is at: width * height floats.
void ReadTiffPage(TIFF* tiff, const TiffPage& page, float* out);

}  // namespace palpate
