// Imports files that a test writes, with palpate-import, as the daemon does.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/error/error.h"
#include "server/volume/load/import_process.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/voxels.h"

namespace palpate {

// What a test says of an ImportRequest.
struct Source {
  std::filesystem::path path{};
  std::optional<Vec3> spacing_mm{};
  std::optional<std::int64_t> frame{};
  std::optional<RawVoxels> raw{};
  std::string grid{};
  std::string component{};
  std::int64_t max_voxels = std::int64_t{1} << 31;

  ImportRequest Request() const {
    ImportRequest request;
    request.source = path;
    request.spacing_mm = spacing_mm;
    request.frame = frame;
    request.raw = raw;
    request.grid = grid;
    request.component = component;
    request.max_voxels = max_voxels;
    request.import_program = test::kPalpateImport;
    return request;
  }
};

class ImportTest : public ::testing::Test {
 protected:
  std::filesystem::path Path(const std::string& name) const { return folder_.path() / name; }
  std::filesystem::path Write(const std::string& name, const std::string& bytes) const {
    std::ofstream(Path(name), std::ios::binary) << bytes;
    return Path(name);
  }
  // The test fails if the import fails. The warnings are kept.
  LoadedVolume Imported(const Source& source) {
    warnings_.clear();
    try {
      return ImportVolume(source.Request(), nullptr, nullptr, &warnings_);
    } catch (const Error& error) {
      ADD_FAILURE() << error.what();
      return {VolumeMetadata{}, BrickDirectory(Vec3i(2, 2, 2), [](const Vec3i&) {
                return Leaf::Constant(LeafType::kUint8, 0.0f);
              })};
    }
  }
  LoadedVolume Imported(const std::filesystem::path& path) {
    return Imported(Source{.path = path});
  }
  // Expects this error: one line about the source, which holds `text`.
  static void ExpectRefused(const Source& source, ErrorKind kind, const std::string& text) {
    try {
      ImportVolume(source.Request(), nullptr, nullptr);
      ADD_FAILURE() << source.path << " was imported";
    } catch (const Error& error) {
      const std::string line = error.what();
      EXPECT_EQ(error.kind(), kind) << line;
      EXPECT_NE(line.find(text), std::string::npos) << line;
      EXPECT_EQ(line.rfind(source.path.string() + ": ", 0), 0u) << line;
      EXPECT_EQ(line.find('\n'), std::string::npos) << line;
    }
  }
  static void ExpectRefused(const std::filesystem::path& path, ErrorKind kind,
                            const std::string& text) {
    ExpectRefused(Source{.path = path}, kind, text);
  }

  test::TemporaryFolder folder_;
  std::vector<std::string> warnings_;  // of the last import
};

inline float At(const LoadedVolume& volume, int x, int y, int z) {
  return volume.bricks.Find(x, y, z)[VoxelInBrick(x, y, z)];
}

// The test pattern: every voxel differs from its neighbours, within 0..120.
constexpr int kPatternSize[3] = {7, 5, 4};
inline int PatternValue(int x, int y, int z) { return (11 * x + 23 * y + 37 * z) % 121; }
inline void ExpectPattern(const LoadedVolume& volume) {
  ASSERT_EQ(volume.metadata.size, Vec3i(kPatternSize[0], kPatternSize[1], kPatternSize[2]));
  testing::ForEachVoxel(volume.metadata.size, [&](const Vec3i& p) {
    ASSERT_EQ(At(volume, p.x(), p.y(), p.z()), PatternValue(p.x(), p.y(), p.z())) << p.transpose();
  });
}

template <typename Number>
std::string BytesOf(Number number, bool big_endian = false) {
  char bytes[sizeof(Number)];
  std::memcpy(bytes, &number, sizeof(Number));
  std::string text(bytes, sizeof(Number));
  return big_endian ? std::string(text.rbegin(), text.rend()) : text;
}

template <typename Number>
std::string PatternBytes(bool big_endian = false) {
  std::string bytes;
  for (int z = 0; z < kPatternSize[2]; ++z) {
    for (int y = 0; y < kPatternSize[1]; ++y) {
      for (int x = 0; x < kPatternSize[0]; ++x) {
        bytes += BytesOf(static_cast<Number>(PatternValue(x, y, z)), big_endian);
      }
    }
  }
  return bytes;
}

}  // namespace palpate
