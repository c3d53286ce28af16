// Runs palpate-import on files that a test writes.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/volume/dense_bricks.h"
#include "tests/support/volume_file.h"

namespace palpate {

struct ImportRun {
  int exit_code = -1;  // -1: killed by a signal
  std::string out;
  std::string err;
};

// True if a library crashed on a damaged file and the importer reported that. With
// AddressSanitizer, true if it ended the importer within OpenVDB or GDCM, which trust their files.
// False for an error in our own code.
bool ReaderCrashed(const ImportRun& run);

ImportRun RunImport(const std::vector<std::string>& arguments);

class ImportTest : public ::testing::Test {
 protected:
  void SetUp() override;
  void TearDown() override;

  std::filesystem::path Write(const std::string& name, const std::string& bytes) const;
  ImportRun Import(const std::filesystem::path& input, std::vector<std::string> options = {}) const;
  // Imports a file and reads the result. The test fails if the import fails.
  VolumeFile Imported(const std::filesystem::path& input,
                      const std::vector<std::string>& options = {}) const;
  // Expects this exit code, one line with this text on stderr, and no output.
  void ExpectRefused(const std::filesystem::path& input, int exit_code, const std::string& text,
                     const std::vector<std::string>& options = {}) const;

  std::filesystem::path folder_;
};

// The test pattern: every voxel differs from its neighbours, within 0..120.
constexpr int kPatternSize[3] = {7, 5, 4};
int PatternValue(int x, int y, int z);
void ExpectPattern(const VolumeFile& file);
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
