// The checks of an image file that the importer's parsers have accepted.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string_view>

#include "server/import/data_check.h"
#include "server/import/voxel_reader.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/scratch_file.h"

namespace palpate::fuzz {

// The most voxels that a header may ask for: more than any file of the corpus has, and few enough
// for thousands of inputs a second.
inline constexpr std::int64_t kMostVoxels = 4096;
inline constexpr std::int64_t kMostFrames = 3;

inline void CheckHeader(const ImageHeader& header) {
  for (const std::int64_t axis : header.size) FUZZ_CHECK(axis >= 2);
  FUZZ_CHECK(header.frames >= 1);
  FUZZ_CHECK(header.begin >= 0);
  FUZZ_CHECK(header.skip_bytes >= ImageHeader::kVoxelsAtEnd);
  FUZZ_CHECK(std::isfinite(header.slope) && std::isfinite(header.intercept));
  const ImageGeometry& geometry = header.geometry;
  FUZZ_CHECK(geometry.spacing_mm.allFinite() && geometry.spacing_mm.minCoeff() > 0.0);
  FUZZ_CHECK(geometry.origin_W_mm.allFinite() && geometry.direction.allFinite());
  const std::filesystem::path data(header.data_file);
  FUZZ_CHECK(data.is_relative());
  for (const auto& part : data) FUZZ_CHECK(part != "..");
}

// Reads the file as the importer does: the header, the presence of the voxels, and the voxels of
// all frames. A header that `parse` refuses never reaches a file.
template <typename Parse>
void ReadImage(std::span<const std::uint8_t> bytes, ImageFormat format, Parse parse) {
  static const ScratchFile file("image");
  static const ImportLimits limits{.max_voxels = kMostVoxels};
  try {
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    if (!text.starts_with("\x1f\x8b")) CheckHeader(parse(text));
    file.Write(bytes);
    const ImageHeader header = ReadCheckedHeader(file.path(), format, limits);
    CheckHeader(header);
    FUZZ_CHECK(header.size[0] * header.size[1] * header.size[2] <= kMostVoxels);
    for (std::int64_t frame = 0; frame < std::min(header.frames, kMostFrames); ++frame) {
      CheckFrame(frame, header.frames);
      FUZZ_CHECK(ReadVoxels(file.path(), header, frame) != nullptr);
    }
  } catch (const Error&) {
    // An Error is expected. Any other exception ends the program.
  }
}

}  // namespace palpate::fuzz
