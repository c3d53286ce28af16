#include "server/import/tiff_page.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>
#include <string>
#include <utility>
#include <vector>

#include "common/error/text.h"
#include "server/import/data_check.h"
#include "server/import/image_header.h"
#include "server/import/voxel_reader.h"

namespace palpate {
namespace {

// The text behind the key, up to `end`; empty if the key is not there.
std::string_view Value(std::string_view text, std::string_view key, char end) {
  const std::size_t at = text.find(key);
  if (at == std::string_view::npos) return {};
  text.remove_prefix(at + key.size());
  return Trim(text.substr(0, text.find(end)));
}

double Number(std::string_view text, double absent) {
  double number = absent;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return std::isfinite(number) ? number : absent;
}

// ImageJ writes the micro sign in Latin-1, or as an escape.
std::optional<double> Millimetres(std::string_view unit) {
  if (unit.empty()) return std::nullopt;
  const bool is_micrometre = unit == "\xb5m" || unit == "\\u00B5m";
  return MillimetresPer(is_micrometre ? "um" : unit);
}

constexpr char kSeveral[] = "the pages are of several channels or times; extract one volume first";

// ImageJ writes signed numbers of 16 bits as unsigned ones with a straight line that gives the
// values back.
void ReadCalibration(std::string_view text, TiffDescription* description) {
  constexpr int kStraightLine = 0, kNone = 20;
  const auto number = [&](std::string_view key, double absent) {
    return Number(Value(text, key, '\n'), absent);
  };
  const double function = number("\ncf=", kStraightLine);
  const double slope = number("\nc1=", 1.0), intercept = number("\nc0=", 0.0);
  const bool is_line =
      function == kStraightLine && slope != 0.0 && std::isfinite(slope + intercept);
  if (!is_line && function != kNone) {
    description->warnings.push_back(
        "ImageJ's calibration of the values is no straight line, and is not applied");
    return;
  }
  const std::string_view unit = Value(text, "\nvunit=", '\n');
  if (unit != "Gray Value") description->unit = unit;
  if (!is_line) return;
  description->slope = slope;
  description->intercept = intercept;
  if (slope == 1.0 && intercept == 0.0) return;
  description->warnings.push_back("the values are those of ImageJ's calibration, " +
                                  NumberText(intercept) + " + " + NumberText(slope) +
                                  " times what is stored" + kReadOtherwise);
}

TiffDescription OfImageJ(std::string_view text, double x_per_unit, double y_per_unit) {
  const auto number = [&](std::string_view key, double absent) {
    return Number(Value(text, key, '\n'), absent);
  };
  TiffDescription description;
  if (number("\nchannels=", 1) != 1 || number("\nframes=", 1) != 1) description.problem = kSeveral;
  const double images = number("\nimages=", 1);
  if (images > 1 && images < 1e9) description.images = static_cast<std::int64_t>(images);
  // What ImageJ leaves out is 1, or as along x.
  const std::string_view unit = Value(text, "\nunit=", '\n');
  const auto mm = [&](std::string_view key) {
    const std::string_view own = Value(text, key, '\n');
    return Millimetres(own.empty() ? unit : own);
  };
  const auto x_mm = Millimetres(unit), y_mm = mm("\nyunit="), z_mm = mm("\nzunit=");
  const double z = std::abs(number("\nspacing=", images > 1 ? 1.0 : 0.0));
  if (x_mm && y_mm && z_mm && x_per_unit > 0.0 && y_per_unit > 0.0 && z > 0.0) {
    description.spacing_mm = Vec3(*x_mm / x_per_unit, *y_mm / y_per_unit, *z_mm * z);
  }
  ReadCalibration(text, &description);
  return description;
}

// With or without a prefix of the name space.
bool IsNamed(const pugi::xml_node& node, std::string_view name) {
  const std::string_view own = node.name();
  return own == name || (own.ends_with(name) && own[own.size() - name.size() - 1] == ':');
}

std::vector<pugi::xml_node> ChildrenOf(const pugi::xml_node& parent, std::string_view name) {
  std::vector<pugi::xml_node> children;
  for (const pugi::xml_node& child : parent.children()) {
    if (IsNamed(child, name)) children.push_back(child);
  }
  return children;
}

// The place of each slice, by OME's TiffData; of a volume with one channel and time.
void ReadPlanes(const pugi::xml_node& pixels, TiffDescription* description) {
  // More slices, or longer names, are of no file that anybody has.
  constexpr std::int64_t kMostSlices = 1 << 16;
  constexpr std::size_t kLongestName = 255;
  const std::int64_t slices = pixels.attribute("SizeZ").as_llong();
  if (slices < 1 || slices > kMostSlices) return;
  std::vector<std::int64_t> pages(static_cast<std::size_t>(slices), -1);
  std::vector<std::string> files(pages.size());
  bool are_stated = false;
  std::int64_t left = 2 * slices;  // a bound for files that state the same again and again
  for (const pugi::xml_node& data : ChildrenOf(pixels, "TiffData")) {
    const std::int64_t first = data.attribute("FirstZ").as_llong(0);
    const std::int64_t page = data.attribute("IFD").as_llong(0);
    const std::int64_t all = data.attribute("IFD") ? 1 : slices;
    const std::int64_t count = data.attribute("PlaneCount").as_llong(all);
    const auto uuid = ChildrenOf(data, "UUID");
    const std::string_view name = uuid.empty() ? "" : uuid[0].attribute("FileName").as_string();
    const std::string file(name.substr(0, kLongestName));
    are_stated = true;
    if (first < 0 || page < 0 || page > kMostSlices) continue;
    for (std::int64_t n = 0; n < count && first + n < slices && left > 0; ++n, --left) {
      pages[static_cast<std::size_t>(first + n)] = page + n;
      files[static_cast<std::size_t>(first + n)] = file;
    }
  }
  if (!are_stated) return;
  description->page_of_slice = std::move(pages);
  const bool is_one =
      std::ranges::all_of(files, [&](const auto& file) { return file == files[0]; });
  if (!is_one) description->file_of_slice = std::move(files);
}

TiffDescription OfOme(std::string_view text) {
  TiffDescription description;
  pugi::xml_document document;
  const bool is_read = document.load_buffer(text.data(), text.size());
  if (!is_read && text.find("<OME") == text.npos) return description;
  const auto images = ChildrenOf(document.document_element(), "Image");
  const auto all_pixels = images.empty() ? images : ChildrenOf(images[0], "Pixels");
  if (is_read && !IsNamed(document.document_element(), "OME")) return description;
  if (!is_read || all_pixels.empty()) {
    description.warnings.push_back(
        "the description in XML (OME) is damaged or says nothing of the pages: they are taken as "
        "slices in their order");
    return description;
  }
  const pugi::xml_node& pixels = all_pixels[0];
  if (images.size() > 1) {
    description.problem = "the pages are of " + std::to_string(images.size()) +
                          " images (of OME); save one of them alone";
  }
  for (const char* size : {"SizeC", "SizeT"}) {
    if (pixels.attribute(size).as_llong(1) != 1) description.problem = kSeveral;
  }
  Vec3 spacing_mm;
  for (int k = 0; k < 3; ++k) {
    const std::string name = std::string("PhysicalSize") + "XYZ"[k];
    const std::string_view unit = pixels.attribute((name + "Unit").c_str()).as_string();
    const std::string_view size = pixels.attribute(name.c_str()).as_string();
    spacing_mm[k] = Millimetres(unit.empty() ? "um" : unit).value_or(0.0) * Number(Trim(size), 0.0);
  }
  if (spacing_mm.minCoeff() > 0.0) description.spacing_mm = spacing_mm;
  ReadPlanes(pixels, &description);
  return description;
}

// `x_per_unit`, `y_per_unit`: the page's resolution, 0 if not stated. ImageJ names its unit in the
// description.
TiffDescription ParseTiffDescription(std::string_view text, double x_per_unit, double y_per_unit) {
  return text.starts_with("ImageJ=") ? OfImageJ(text, x_per_unit, y_per_unit) : OfOme(text);
}

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
