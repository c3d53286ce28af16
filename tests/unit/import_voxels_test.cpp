// Frames of files: every type and order of bytes, deflated or not, and
// raw voxels.
#include <cstring>
#include <fstream>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "server/import/file_headers.h"
#include "server/import/voxel_reader.h"
#include "tests/support/deflated.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/collected_voxels.h"
#include "tests/unit/import_refusal.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using testing::CollectedVoxels;
using testing::Deflated;
using testing::Refusal;

constexpr int kVoxels = 7 * 5 * 4;

int Value(int voxel, int frame) { return (voxel * 7 + frame * 11) % 120; }

template <typename Number>
std::string Frames(int frames, bool big_endian) {
  std::string bytes;
  for (int k = 0; k < frames * kVoxels; ++k) {
    const auto number = static_cast<Number>(Value(k % kVoxels, k / kVoxels));
    char one[sizeof(Number)];
    std::memcpy(one, &number, sizeof(Number));
    if (big_endian) std::reverse(one, one + sizeof(Number));
    bytes.append(one, sizeof(Number));
  }
  return bytes;
}

class Voxels : public ::testing::Test {
 protected:
  fs::path Write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_.path() / name, std::ios::binary) << bytes;
    return folder_.path() / name;
  }
  test::TemporaryFolder folder_;
};

CollectedVoxels Read(const fs::path& path, const ImageHeader& header, int frame) {
  CollectedVoxels voxels;
  ReadVoxels(path, header, frame, voxels.Sink());
  return voxels;
}

// Expects the type of the file where leaves have it.
void ExpectFrame(const fs::path& path, const ImageHeader& header, int frame) {
  const CollectedVoxels voxels = Read(path, header, frame);
  EXPECT_EQ(voxels.type, LeafTypeNamed(Name(header.type)).value_or(LeafType::kFloat));
  ASSERT_EQ(voxels.values.size(), std::size_t{kVoxels});
  for (int k = 0; k < kVoxels; ++k) ASSERT_EQ(voxels.values[k], Value(k, frame)) << k;
}

TEST_F(Voxels, EveryTypeOrderAndFrame) {
  const std::pair<const char*, std::string (*)(int, bool)> types[] = {
      {"int8", Frames<std::int8_t>},   {"uint8", Frames<std::uint8_t>},
      {"int16", Frames<std::int16_t>}, {"uint16", Frames<std::uint16_t>},
      {"int32", Frames<std::int32_t>}, {"uint32", Frames<std::uint32_t>},
      {"float32", Frames<float>},      {"float64", Frames<double>}};
  for (const auto& [name, frames] : types) {
    for (const bool big : {false, true}) {
      SCOPED_TRACE(std::string(name) + (big ? " big" : ""));
      ImageHeader header;
      header.type = ParseScalarType(name);
      EXPECT_STREQ(Name(header.type), name);
      header.size = {7, 5, 4};
      header.frames = 3;
      header.big_endian = big;
      const std::string data = frames(3, big);
      for (int frame = 0; frame < 3; ++frame) {
        header.compressed = false;
        header.skip_bytes = 9;
        ExpectFrame(Write("a", "before it" + data), header, frame);
        header.skip_bytes = ImageHeader::kVoxelsAtEnd;
        ExpectFrame(Write("b", "whatever is before it" + data), header, frame);
        header.compressed = true;
        header.skip_bytes = 9;
        ExpectFrame(Write("c", Deflated("before it" + data, /*gzip=*/false)), header, frame);
      }
    }
  }
}

TEST_F(Voxels, AreScaled) {
  ImageHeader header;
  header.type = ScalarType::kUint8;
  header.size = {7, 5, 4};
  header.slope = 0.5;
  header.intercept = -8.0;
  const fs::path path = Write("a", Frames<std::uint8_t>(1, false));
  const CollectedVoxels voxels = Read(path, header, 0);
  EXPECT_EQ(voxels.type, LeafType::kFloat);
  EXPECT_EQ(voxels.values[9], 0.5f * static_cast<float>(Value(9, 0)) - 8.0f);
}

// The check and the reading are two: the file may have changed between them.
TEST_F(Voxels, AFileThatShrankIsRefused) {
  ImageHeader header;
  header.type = ScalarType::kInt16;
  header.size = {7, 5, 4};
  const fs::path path = Write("a", Frames<std::int16_t>(1, false).substr(1));
  EXPECT_NE(Refusal([&] { Read(path, header, 0); }).find("truncated"), std::string::npos);
}

TEST_F(Voxels, RawNeedsTheExactSize) {
  const std::string data = Frames<std::uint16_t>(1, false);
  RawVoxels raw{.size = {7, 5, 4}, .type = "uint16"};
  ExpectFrame(Write("a", data), CheckedRawHeader(Write("a", data), raw, {}), 0);
  raw.offset_bytes = 10;
  const fs::path skipped = Write("b", "0123456789" + data);
  ExpectFrame(skipped, CheckedRawHeader(skipped, raw, {}), 0);
  for (const std::string& bytes : {data, data + "012345678", data + "0123456789a"}) {
    const std::string what = Refusal([&] { CheckedRawHeader(Write("c", bytes), raw, {}); });
    EXPECT_NE(what.find(std::to_string(bytes.size())), std::string::npos) << what;
    EXPECT_NE(what.find(std::to_string(data.size())), std::string::npos) << what;
  }
}

TEST_F(Voxels, HostileRawSizesAreRefused) {
  const fs::path path = Write("a", Frames<std::uint8_t>(1, false));
  const auto refused = [&](const RawVoxels& raw) {
    return Refusal([&] { CheckedRawHeader(path, raw, {}); }) != "";
  };
  const std::int64_t huge = std::numeric_limits<std::int64_t>::max();
  EXPECT_FALSE(refused({.size = {7, 5, 4}, .type = "uint8"}));
  EXPECT_TRUE(refused({.size = {7, 5, 4}, .type = "uint16"}));
  EXPECT_TRUE(refused({.size = {7, 5, 4}, .type = "char"}));
  EXPECT_TRUE(refused({.size = {7, 5, 4}, .type = ""}));
  EXPECT_TRUE(refused({.size = {7, -5, -4}, .type = "uint8"}));
  EXPECT_TRUE(refused({.size = {140, 1, 1}, .type = "uint8"}));
  EXPECT_TRUE(refused({.size = {0, 5, 4}, .type = "uint8"}));
  EXPECT_TRUE(refused({.size = {huge, huge, huge}, .type = "float64"}));
  EXPECT_TRUE(refused({.size = {7, 5, 4}, .type = "uint8", .offset_bytes = -1}));
  EXPECT_TRUE(refused({.size = {7, 5, 4}, .type = "uint8", .offset_bytes = huge}));
}

}  // namespace
}  // namespace palpate
