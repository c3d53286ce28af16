#include "server/import/tiff_page.h"

#include <algorithm>
#include <bit>
#include <string>
#include <vector>

#include "server/import/data_check.h"
#include "server/import/voxel_reader.h"

namespace palpate {
namespace {

// A tile may be larger than its page. This limit keeps a huge tile from taking too much memory.
constexpr std::uint64_t kLargestTileBytes = std::uint64_t{64} << 20;

constexpr char kDamaged[] = "the TIFF data are damaged or truncated; copy or export the file again";

template <typename Number>
Number Tag(TIFF* tiff, std::uint32_t tag) {
  Number value{};
  TIFFGetFieldDefaulted(tiff, tag, &value);
  return value;
}

ScalarType ParseType(TIFF* tiff) {
  const auto bits = Tag<std::uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE);
  switch (Tag<std::uint16_t>(tiff, TIFFTAG_SAMPLEFORMAT)) {
    case SAMPLEFORMAT_UINT:
    case SAMPLEFORMAT_VOID:
      if (bits == 8) return ScalarType::kUint8;
      if (bits == 16) return ScalarType::kUint16;
      if (bits == 32) return ScalarType::kUint32;
      break;
    case SAMPLEFORMAT_INT:
      if (bits == 8) return ScalarType::kInt8;
      if (bits == 16) return ScalarType::kInt16;
      if (bits == 32) return ScalarType::kInt32;
      break;
    case SAMPLEFORMAT_IEEEFP:
      if (bits == 32) return ScalarType::kFloat32;
      if (bits == 64) return ScalarType::kFloat64;
      break;
  }
  Refuse("TIFF voxels of " + std::to_string(bits) +
         " bits of this kind are not supported; convert them to 8, 16 or 32 bit integers, float "
         "or double");
}

void CheckGrey(TIFF* tiff) {
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &photometric);
  if (Tag<std::uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL) != 1 ||
      (photometric != PHOTOMETRIC_MINISBLACK && photometric != PHOTOMETRIC_MINISWHITE)) {
    Refuse("this is a colour image; convert it to grey values, or extract one channel");
  }
}

void CheckDataPlaces(TIFF* tiff, const TiffPage& page) {
  const bool tiled = TIFFIsTiled(tiff) != 0;
  const std::uint64_t part_bytes = tiled ? TIFFTileSize64(tiff) : TIFFStripSize64(tiff);
  const auto page_bytes = static_cast<std::uint64_t>(page.width) *
                          static_cast<std::uint64_t>(page.height) *
                          static_cast<std::uint64_t>(ByteCount(page.type));
  if (part_bytes == 0 || part_bytes > std::max(page_bytes, kLargestTileBytes)) Refuse(kDamaged);
  const auto file_bytes = static_cast<std::uint64_t>(TIFFGetSizeProc(tiff)(TIFFClientdata(tiff)));
  const std::uint32_t parts = tiled ? TIFFNumberOfTiles(tiff) : TIFFNumberOfStrips(tiff);
  const bool plain = Tag<std::uint16_t>(tiff, TIFFTAG_COMPRESSION) == COMPRESSION_NONE;
  std::uint64_t stored_bytes = 0;
  for (std::uint32_t part = 0; part < parts; ++part) {
    const std::uint64_t begin = TIFFGetStrileOffset(tiff, part);
    const std::uint64_t length = TIFFGetStrileByteCount(tiff, part);
    if (begin == 0 || length == 0 || begin > file_bytes || length > file_bytes - begin) {
      Refuse(kDamaged);
    }
    stored_bytes += length;
  }
  if (parts == 0 || (plain && stored_bytes < page_bytes)) Refuse(kDamaged);
}

void ReadStrips(TIFF* tiff, const TiffPage& page, const ImageHeader& header, char* out) {
  const auto out_row_bytes = page.width * static_cast<std::int64_t>(VoxelBytes(ReadType(header)));
  std::vector<char> strip(static_cast<std::size_t>(TIFFStripSize64(tiff)));
  const std::int64_t row_bytes = page.width * ByteCount(page.type);
  const std::int64_t strip_rows =
      std::min<std::int64_t>(Tag<std::uint32_t>(tiff, TIFFTAG_ROWSPERSTRIP), page.height);
  std::uint32_t number = 0;
  for (std::int64_t row = 0; row < page.height; row += strip_rows, ++number) {
    const std::int64_t rows = std::min(strip_rows, page.height - row);
    const std::int64_t bytes = rows * row_bytes;
    if (bytes > std::ssize(strip) ||
        TIFFReadEncodedStrip(tiff, number, strip.data(), bytes) != bytes) {
      Refuse(kDamaged);
    }
    DecodeVoxels(strip.data(), static_cast<std::size_t>(rows * page.width), header,
                 out + row * out_row_bytes);
  }
}

void ReadTiles(TIFF* tiff, const TiffPage& page, const ImageHeader& header, char* out) {
  const auto out_bytes = static_cast<std::int64_t>(VoxelBytes(ReadType(header)));
  std::vector<char> tile(static_cast<std::size_t>(TIFFTileSize64(tiff)));
  const std::int64_t width = Tag<std::uint32_t>(tiff, TIFFTAG_TILEWIDTH);
  const std::int64_t height = Tag<std::uint32_t>(tiff, TIFFTAG_TILELENGTH);
  const std::int64_t voxel_bytes = ByteCount(page.type);
  if (width * height * voxel_bytes > std::ssize(tile)) Refuse(kDamaged);
  std::uint32_t number = 0;
  for (std::int64_t top = 0; top < page.height; top += height) {
    for (std::int64_t left = 0; left < page.width; left += width, ++number) {
      const auto bytes = static_cast<tmsize_t>(tile.size());
      if (TIFFReadEncodedTile(tiff, number, tile.data(), bytes) != bytes) Refuse(kDamaged);
      const std::int64_t columns = std::min(width, page.width - left);
      for (std::int64_t row = top; row < std::min(top + height, page.height); ++row) {
        DecodeVoxels(tile.data() + (row - top) * width * voxel_bytes,
                     static_cast<std::size_t>(columns), header,
                     out + (row * page.width + left) * out_bytes);
      }
    }
  }
}

}  // namespace

TiffFile OpenTiff(const std::filesystem::path& path) {
  CheckReadable(path);
  TIFFSetErrorHandler(nullptr);
  TIFFSetWarningHandler(nullptr);
  // m: no memory map, because a shrinking file would cause a crash.
  TiffFile file(TIFFOpen(path.c_str(), "rm"));
  if (!file) Refuse("this is no TIFF file, or its header is damaged or truncated");
  return file;
}

bool IsAuxiliaryPage(TIFF* tiff) {
  return (Tag<std::uint32_t>(tiff, TIFFTAG_SUBFILETYPE) &
          (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) != 0;
}

TiffDescription DescribeTiff(TIFF* tiff) {
  const char* text = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_IMAGEDESCRIPTION, &text) != 1 || !text) return {};
  return ParseTiffDescription(text, Tag<float>(tiff, TIFFTAG_XRESOLUTION),
                              Tag<float>(tiff, TIFFTAG_YRESOLUTION));
}

TiffPage CheckTiffPage(TIFF* tiff) {
  CheckGrey(tiff);
  TiffPage page;
  page.type = ParseType(tiff);
  page.width = Tag<std::uint32_t>(tiff, TIFFTAG_IMAGEWIDTH);
  page.height = Tag<std::uint32_t>(tiff, TIFFTAG_IMAGELENGTH);
  const auto compression = Tag<std::uint16_t>(tiff, TIFFTAG_COMPRESSION);
  if (TIFFIsCODECConfigured(compression) == 0) {
    Refuse("the TIFF compression " + std::to_string(compression) +
           " is not supported; save the file without compression");
  }
  // Above every limit of voxels, and small enough that the products below do not overflow.
  constexpr std::int64_t kLongestAxis = std::int64_t{1} << 30;
  if (page.width < 1 || page.height < 1 || page.width > kLongestAxis ||
      page.height > kLongestAxis) {
    Refuse("the TIFF page is " + std::to_string(page.width) + "x" + std::to_string(page.height) +
           " voxels; the file is damaged");
  }
  CheckDataPlaces(tiff, page);
  return page;
}

ImageHeader DecodeHeader(const TiffPage& page) {
  ImageHeader header;
  header.type = page.type;
  header.big_endian = std::endian::native == std::endian::big;
  return header;
}

void ReadTiffPage(TIFF* tiff, const TiffPage& page, const ImageHeader& header, char* out) {
  TIFFIsTiled(tiff) ? ReadTiles(tiff, page, header, out) : ReadStrips(tiff, page, header, out);
}

}  // namespace palpate
