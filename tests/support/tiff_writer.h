// Writes small TIFF files through libtiff.
#pragma once

#include <tiffio.h>

#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace palpate::testing {

struct TiffLayout {
  std::uint32_t width = 7;
  std::uint32_t height = 5;
  int pages = 4;
  std::uint16_t bits = 16;
  std::uint16_t format = SAMPLEFORMAT_UINT;
  std::uint16_t samples = 1;
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  std::uint16_t compression = COMPRESSION_NONE;
  std::uint32_t rows_per_strip = 2;
  std::uint32_t tile = 0;   // edge of a tile; 0: strips
  const char* mode = "wl";  // b: big endian, 8: BigTIFF
  std::string description{};
  std::uint32_t subfile_type = 0;  // of the last page
  float per_unit = 0.0f;           // resolution along x and y
};

// `value(x, y, page)`: converted to the byte count and format of the layout.
template <typename Number, typename Value>
void WriteTiff(const std::filesystem::path& path, const TiffLayout& layout, const Value& value) {
  TIFF* const tiff = TIFFOpen(path.c_str(), layout.mode);
  if (!tiff) throw std::runtime_error("cannot write " + path.string());
  const auto check = [](bool good) {
    if (!good) throw std::runtime_error("libtiff refuses to write");
  };
  for (int page = 0; page < layout.pages; ++page) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, layout.width);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, layout.height);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, layout.bits);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, layout.format);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, layout.samples);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, layout.photometric);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, layout.compression);
    if (!layout.description.empty()) {
      TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, layout.description.c_str());
    }
    if (layout.per_unit > 0.0f) {
      TIFFSetField(tiff, TIFFTAG_XRESOLUTION, layout.per_unit);
      TIFFSetField(tiff, TIFFTAG_YRESOLUTION, layout.per_unit);
    }
    if (page + 1 == layout.pages) TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, layout.subfile_type);
    const auto at = [&](std::uint32_t x, std::uint32_t y) {
      return static_cast<Number>(value(static_cast<int>(x), static_cast<int>(y), page));
    };
    if (layout.tile > 0) {
      TIFFSetField(tiff, TIFFTAG_TILEWIDTH, layout.tile);
      TIFFSetField(tiff, TIFFTAG_TILELENGTH, layout.tile);
      std::vector<Number> tile(layout.tile * layout.tile * layout.samples);
      for (std::uint32_t y = 0; y < layout.height; y += layout.tile) {
        for (std::uint32_t x = 0; x < layout.width; x += layout.tile) {
          for (std::uint32_t k = 0; k < layout.tile * layout.tile; ++k) {
            tile[k] = at(x + k % layout.tile, y + k / layout.tile);
          }
          check(TIFFWriteTile(tiff, tile.data(), x, y, 0, 0) >= 0);
        }
      }
    } else {
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, layout.rows_per_strip);
      std::vector<Number> row(layout.width * layout.samples);
      for (std::uint32_t y = 0; y < layout.height; ++y) {
        for (std::uint32_t x = 0; x < row.size(); ++x) row[x] = at(x / layout.samples, y);
        check(TIFFWriteScanline(tiff, row.data(), y, 0) >= 0);
      }
    }
    check(TIFFWriteDirectory(tiff) != 0);
  }
  TIFFClose(tiff);
}

}  // namespace palpate::testing
