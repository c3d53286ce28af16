// Reads one page of a TIFF file with libtiff: grey, in strips or tiles; and what ImageJ and OME
// write into its description.
//
// Threads: one. Reads files. Errors: palpate::Error without the file's name.
#pragma once

#include <tiffio.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/import/image_header.h"

namespace palpate {

// What ImageJ and OME write into the description of a TIFF file. What cannot be read is not stated.
struct TiffDescription {
  std::string problem{};             // why the pages are no volume; empty: they may be one
  std::optional<Vec3> spacing_mm{};  // along x, y and z, if all are stated
  std::int64_t images = 1;           // ImageJ: of the whole file
  // ImageJ: the value of a voxel is intercept + slope * voxel.
  double slope = 1.0;
  double intercept = 0.0;
  std::string unit{};  // of the values
  std::vector<std::string> warnings{};
  // OME: the page of each slice, and its file if there are several. Empty: in the order of pages.
  std::vector<std::int64_t> page_of_slice{};
  std::vector<std::string> file_of_slice{};
};

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
