// Bytes of small NIfTI and DICOM files.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>

#include "tests/integration/import_support.h"

namespace palpate {

// Signed shorts, with a scale: 2 v - 10. `X_RasI`: mm.
inline std::string NiftiBytes(const Vec3i& size, const AffineMap& X_RasI, const std::string& data) {
  std::string bytes(352, '\0');
  const auto put = [&bytes](std::size_t offset, auto number) {
    bytes.replace(offset, sizeof number, BytesOf(number));
  };
  put(0, std::int32_t{348});
  put(40, std::int16_t{3});
  for (int k = 0; k < 7; ++k) put(42 + 2 * k, static_cast<std::int16_t>(k < 3 ? size[k] : 1));
  put(70, std::int16_t{4});
  put(72, std::int16_t{16});
  put(76, 1.0f);
  for (int k = 0; k < 3; ++k) put(80 + 4 * k, static_cast<float>(X_RasI.linear.col(k).norm()));
  put(108, 352.0f);
  put(112, 2.0f);
  put(116, -10.0f);
  bytes[123] = 2;  // mm
  put(254, std::int16_t{1});
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < 3; ++k) {
      put(280 + 16 * row + 4 * k, static_cast<float>(X_RasI.linear(row, k)));
    }
    put(292 + 16 * row, static_cast<float>(X_RasI.translation[row]));
  }
  std::memcpy(bytes.data() + 344, "n+1", 4);
  return bytes + data;
}

// A slice of a DICOM series: values 2 v - 1024.
struct SliceFile {
  double height_mm = 0.0;
  int z = 0;  // its number
  std::string series = "1.2.3";
  std::string instance{};  // empty: of its series and number
  std::string syntax = "1.2.840.10008.1.2.1";
  std::string modality = "CT";
  std::string orientation = "1\\0\\0\\0\\1\\0";
  bool has_place = true;
  std::string shift = "10\\20\\";     // of the position, before the height
  std::string spacing = "0.75\\0.5";  // of rows, of columns
  std::string spacing_type = "DS";
  std::string photometric = "MONOCHROME2";
  std::string frames{};
  std::uint16_t columns = kPatternSize[0];
  std::uint16_t rows = kPatternSize[1];
  bool has_rescale = true;
  std::string rescale_type{};
  std::string elements{};               // before the pixels
  std::uint16_t pixels_element = 0x10;  // 8, 9: float and double pixels
  std::string pixels{};                 // int16, or fragments
  bool has_fragments = false;
};

// Explicit VR, little endian.
inline void Append(std::string* out, std::uint16_t group, std::uint16_t element, const char* vr,
                   std::string value) {
  const std::string kind(vr);
  if (value.size() % 2 != 0) value += kind == "UI" || kind == "OB" ? '\0' : ' ';
  *out += BytesOf(group) + BytesOf(element) + kind;
  if (kind == "OW" || kind == "OB" || kind == "UT" || kind == "SQ") {
    *out += std::string(2, '\0') + BytesOf(static_cast<std::uint32_t>(value.size()));
  } else {
    *out += BytesOf(static_cast<std::uint16_t>(value.size()));
  }
  *out += value;
}

inline std::string DicomBytes(const SliceFile& slice) {
  const std::string ct = "1.2.840.10008.5.1.4.1.1.2";
  const std::string instance =
      slice.instance.empty() ? slice.series + "." + std::to_string(slice.z + 1) : slice.instance;
  std::string meta;
  Append(&meta, 2, 1, "OB", std::string("\0\1", 2));
  Append(&meta, 2, 2, "UI", ct);
  Append(&meta, 2, 3, "UI", instance);
  Append(&meta, 2, 0x10, "UI", slice.syntax);
  std::string out = std::string(128, '\0') + "DICM";
  Append(&out, 2, 0, "UL", BytesOf(static_cast<std::uint32_t>(meta.size())));
  out += meta;
  const auto u16 = [](int value) { return BytesOf(static_cast<std::uint16_t>(value)); };
  Append(&out, 8, 0x16, "UI", ct);
  Append(&out, 8, 0x18, "UI", instance);
  Append(&out, 8, 0x60, "CS", slice.modality);
  Append(&out, 0x20, 0xd, "UI", "1.2.9");
  Append(&out, 0x20, 0xe, "UI", slice.series);
  Append(&out, 0x20, 0x11, "IS", "7");
  Append(&out, 0x20, 0x13, "IS", std::to_string(slice.z + 1));
  if (slice.has_place) {
    Append(&out, 0x20, 0x32, "DS", slice.shift + std::to_string(slice.height_mm));
    Append(&out, 0x20, 0x37, "DS", slice.orientation);
  }
  Append(&out, 0x28, 2, "US", u16(1));
  Append(&out, 0x28, 4, "CS", slice.photometric);
  if (!slice.frames.empty()) Append(&out, 0x28, 8, "IS", slice.frames);
  Append(&out, 0x28, 0x10, "US", u16(slice.rows));
  Append(&out, 0x28, 0x11, "US", u16(slice.columns));
  Append(&out, 0x28, 0x30, slice.spacing_type.c_str(), slice.spacing);
  Append(&out, 0x28, 0x100, "US", u16(16));
  Append(&out, 0x28, 0x101, "US", u16(16));
  Append(&out, 0x28, 0x102, "US", u16(15));
  Append(&out, 0x28, 0x103, "US", u16(1));
  if (slice.has_rescale) {
    Append(&out, 0x28, 0x1052, "DS", "-1024");
    Append(&out, 0x28, 0x1053, "DS", "2");
  }
  if (!slice.rescale_type.empty()) Append(&out, 0x28, 0x1054, "LO", slice.rescale_type);
  out += slice.elements;
  if (slice.has_fragments) {
    return out + std::string("\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff", 12) + slice.pixels;
  }
  Append(&out, 0x7fe0, slice.pixels_element, "OW", slice.pixels);
  return out;
}

}  // namespace palpate
