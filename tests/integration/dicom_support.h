// DICOM series of the test pattern.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "tests/integration/image_bytes.h"
#include "tests/integration/import_support.h"

namespace palpate {

// Of the pattern, before a test changes it.
inline SliceFile PatternSlice(int z) {
  SliceFile slice;
  slice.z = z;
  slice.height_mm = 30.0 + 2.0 * z;
  return slice;
}

// The pattern's slice with these columns.
inline std::string PatternDicom(SliceFile slice) {
  for (int y = 0; y < slice.rows && !slice.has_fragments; ++y) {
    for (int x = 0; x < slice.columns; ++x) {
      slice.pixels += BytesOf(static_cast<std::int16_t>(PatternValue(x, y, slice.z)));
    }
  }
  return DicomBytes(slice);
}

class DicomTest : public ImportTest {
 protected:
  // Four slices with pitch 2 mm, named against their order, each changed first. `padding`: the
  // bytes behind each.
  std::filesystem::path WriteSeries(const std::function<void(SliceFile*)>& change = nullptr,
                                    const std::string& padding = "") {
    std::filesystem::remove_all(Path("series"));
    std::filesystem::create_directory(Path("series"));
    for (int z = 0; z < kPatternSize[2]; ++z) {
      SliceFile slice = PatternSlice(z);
      if (change) change(&slice);
      Write("series/" + std::to_string(9 - z) + ".dcm", PatternDicom(slice) + padding);
    }
    return Path("series");
  }

  static void ExpectSlices(const LoadedVolume& volume) {
    ASSERT_EQ(volume.metadata.size, Vec3i(7, 5, 4));
    for (int z = 0; z < 4; ++z) {
      EXPECT_EQ(At(volume, 3, 2, z), 2 * PatternValue(3, 2, z) - 1024);
    }
  }
};

}  // namespace palpate
