// Reads one page of a TIFF file with libtiff: grey, in strips or tiles.
//
// Threads: one. Reads files. Errors: palpate::Error without the file's name.
#pragma once

#include <tiffio.h>

#include <filesystem>
#include <memory>

#include "server/import/image_header.h"
#include "server/import/tiff_description.h"

namespace palpate {

struct TiffCloser {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffFile = std::unique_ptr<TIFF, TiffCloser>;

// Opens a file at its first page. Suppresses libtiff's own messages.
TiffFile OpenTiff(const std::filesystem::path& path);

// Size along x and y, and type, of the file's current page. CheckTiffPage refuses colour,
// unsupported types, too large tiles, and data beyond the file's end.
struct TiffPage {
  std::int64_t width = 0;
  std::int64_t height = 0;
  ScalarType type = ScalarType::kUint8;

  bool operator==(const TiffPage&) const = default;
};
TiffPage CheckTiffPage(TIFF* tiff);

// Of the file's current page.
TiffDescription DescribeTiff(TIFF* tiff);

// True if the page is a smaller copy or a mask of another page.
bool IsAuxiliaryPage(TIFF* tiff);

// libtiff delivers all values in the machine's byte order.
ImageHeader DecodeHeader(const TiffPage& page);

// Reads the file's current page: width * height voxels of ReadType(header). `header`: that of
// DecodeHeader(), with the scale of the values.
void ReadTiffPage(TIFF* tiff, const TiffPage& page, const ImageHeader& header, char* out);

}  // namespace palpate
