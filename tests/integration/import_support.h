// Imports files that a test writes, with palpate-import, as the daemon does.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/error/error.h"
#include "server/volume/import_process.h"
#include "tests/support/temporary_folder.h"

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

  ImportRequest Request() const;
};

class ImportTest : public ::testing::Test {
 protected:
  std::filesystem::path Path(const std::string& name) const { return folder_.path() / name; }
  std::filesystem::path Write(const std::string& name, const std::string& bytes) const;
  // The test fails if the import fails. The warnings are kept.
  LoadedVolume Imported(const Source& source);
  LoadedVolume Imported(const std::filesystem::path& path) {
    return Imported(Source{.path = path});
  }
  // Expects this error: one line about the source, which holds `text`.
  static void ExpectRefused(const Source& source, ErrorKind kind, const std::string& text);
  static void ExpectRefused(const std::filesystem::path& path, ErrorKind kind,
                            const std::string& text) {
    ExpectRefused(Source{.path = path}, kind, text);
  }

  test::TemporaryFolder folder_;
  std::vector<std::string> warnings_;  // of the last import
};

float At(const LoadedVolume& volume, int x, int y, int z);

// The test pattern: every voxel differs from its neighbours, within 0..120.
constexpr int kPatternSize[3] = {7, 5, 4};
int PatternValue(int x, int y, int z);
void ExpectPattern(const LoadedVolume& volume);

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
