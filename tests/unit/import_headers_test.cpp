#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/import/image_header.h"
#include "server/import/meta_image_header.h"
#include "server/import/nifti_header.h"
#include "server/import/nrrd_header.h"

namespace palpate {
namespace {

using Size = std::array<std::int64_t, 3>;

// Every refusal is one line that also says what to do.
template <typename Parse>
std::string Refusal(const Parse& parse) {
  try {
    parse();
  } catch (const Error& error) {
    const std::string what = error.what();
    EXPECT_TRUE(error.kind() == ErrorKind::kInvalidArgument ||
                error.kind() == ErrorKind::kTooLarge);
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
    EXPECT_FALSE(what.empty());
    return what;
  }
  return {};
}

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

// ---------------------------------------------------------------- NRRD

const char kNrrd[] =
    "NRRD0004\n# comment\ntype: int16\ndimension: 3\nsizes: 20 11 9\nspacings: 1 1 1.5\n"
    "endian: little\nencoding: raw\nkey:=value\n\n";

ImageHeader Nrrd(const std::string& text) { return ParseNrrdHeader(text, true); }

TEST(NrrdHeader, AttachedRaw) {
  const ImageHeader header = Nrrd(std::string(kNrrd) + "voxels");
  EXPECT_EQ(header.size, (Size{20, 11, 9}));
  EXPECT_EQ(header.type, ScalarType::kInt16);
  EXPECT_EQ(header.begin, static_cast<std::int64_t>(std::strlen(kNrrd)));
  EXPECT_FALSE(header.compressed);
  EXPECT_TRUE(header.data_file.empty());
}

TEST(NrrdHeader, CarriageReturnsAndUnit) {
  const ImageHeader header = Nrrd(
      "NRRD0005\r\ntype: uchar\r\ndimension: 3\r\nsizes: 2 3 4\r\nencoding: gz\r\n"
      "sample units: \"HU\"\r\n\r\nxx");
  EXPECT_EQ(header.size, (Size{2, 3, 4}));
  EXPECT_EQ(header.unit, "HU");
  EXPECT_TRUE(header.compressed);
}

TEST(NrrdHeader, DetachedWithSkip) {
  const ImageHeader header =
      Nrrd(Replaced(kNrrd, "key:=value", "data file: a b.raw\nbyte skip: -1"));
  EXPECT_EQ(header.data_file, "a b.raw");
  EXPECT_EQ(header.begin, 0);
  EXPECT_EQ(header.skip_bytes, ImageHeader::kVoxelsAtEnd);
}

TEST(NrrdHeader, TrailingAxesOfOneAreFine) {
  EXPECT_EQ(Nrrd(Replaced(Replaced(kNrrd, "sizes: 20 11 9", "sizes: 20 11 9 1"), "dimension: 3",
                          "dimension: 4"))
                .size,
            (Size{20, 11, 9}));
}

TEST(NrrdHeader, SpaceDirections) {
  const std::string good =
      Replaced(kNrrd, "spacings: 1 1 1.5",
               "space directions: (1,0,0) (0, 1, 0) (0,0,2)\nspace origin: (0,0,0)");
  EXPECT_NO_THROW(Nrrd(good));
  for (const char* bad : {"(0,0,0)", "(nan,0,0)", "(1,0", "1,0,0", "(a,0,0)", "(1e400,0,0)"}) {
    EXPECT_NE(Refusal([&] { Nrrd(Replaced(good, "(1,0,0)", bad)); }), "") << bad;
  }
  EXPECT_NE(Refusal([&] { Nrrd(Replaced(good, "origin: (0", "origin: (nan")); }), "");
}

TEST(NrrdHeader, AttacksAreRefused) {
  const std::vector<std::pair<std::string, std::string>> attacks = {
      {"NRRD0004", "NRRD0009"},
      {"NRRD0004", "nrrd0004"},
      {"NRRD0004\n", "NRRD0004 \n"},
      {"type: int16\n", ""},
      {"type: int16", "type: int64"},
      {"type: int16", "type: block"},
      {"dimension: 3\n", ""},
      {"dimension: 3", "dimension: 4"},
      {"dimension: 3", "dimension: -3"},
      {"dimension: 3", "dimension: three"},
      {"sizes: 20 11 9", "sizes: 20 11"},
      {"sizes: 20 11 9", "sizes: 20 11 0"},
      {"sizes: 20 11 9", "sizes: 20 11 1"},
      {"sizes: 20 11 9", "sizes: 20 -11 -9"},
      {"sizes: 20 11 9", "sizes: 20 11 9.5"},
      {"sizes: 20 11 9", "sizes: 20 11 99999999999999999999"},
      {"sizes: 20 11 9", "sizes: 20 11 9\nsizes: 20 11 9"},
      {"spacings: 1 1 1.5", "spacings: 1 1 0"},
      {"spacings: 1 1 1.5", "spacings: 1 -1 1"},
      {"spacings: 1 1 1.5", "spacings: nan 1 1"},
      {"spacings: 1 1 1.5", "spacings: 1 inf 1"},
      {"spacings: 1 1 1.5", "spacings: 1 1 x"},
      {"endian: little\n", ""},
      {"endian: little", "endian: middle"},
      {"encoding: raw\n", ""},
      {"encoding: raw", "encoding: ascii"},
      {"encoding: raw", "encoding: bzip2"},
      {"encoding: raw", "encoding: gzip\nbyte skip: -1"},
      {"encoding: raw", "encoding: raw\nbyte skip: -2"},
      {"encoding: raw", "encoding: raw\nline skip: 3"},
      {"key:=value", "data file: /etc/passwd"},
      {"key:=value", "data file: ../secret.raw"},
      {"key:=value", "data file: a/../../secret.raw"},
      {"key:=value", "data file:"},
      {"key:=value", "data file: LIST"},
      {"key:=value", "data file: slice%03d.raw 1 9 1"},
      {"key:=value", "no field"},
      {"key:=value", std::string("a: \0b", 5)},
      {"key:=value", "a: " + std::string(10000, 'x')},
  };
  for (const auto& [from, to] : attacks) {
    EXPECT_NE(Refusal([&] { Nrrd(Replaced(kNrrd, from, to)); }), "") << from << " -> " << to;
  }
}

TEST(NrrdHeader, VectorsAndSeriesAreRefused) {
  const std::string four = Replaced(kNrrd, "dimension: 3", "dimension: 4");
  EXPECT_NE(Refusal([&] { Nrrd(Replaced(four, "20 11 9", "20 11 9 7")); }).find("more than three"),
            std::string::npos);
  EXPECT_NE(Refusal([&] {
              Nrrd(Replaced(Replaced(four, "20 11 9", "3 20 11 9"), "key:=value",
                            "kinds: RGB-color domain domain domain"));
            }).find("several values"),
            std::string::npos);
}

TEST(NrrdHeader, EveryPrefixIsHandled) {
  const std::string text = kNrrd;
  for (std::size_t length = 0; length < text.size(); ++length) {
    Refusal([&] { Nrrd(text.substr(0, length)); });
    Refusal([&] { ParseNrrdHeader(text.substr(0, length), false); });
  }
}

// ---------------------------------------------------------------- MetaImage

const char kMeta[] =
    "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
    "CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n"
    "ElementSpacing = 1 1 1.5\nDimSize = 20 11 9\nElementType = MET_SHORT\n"
    "ElementDataFile = LOCAL\n";

TEST(MetaImageHeader, LocalAndDetached) {
  const ImageHeader local = ParseMetaImageHeader(std::string(kMeta) + "\x01\x02");
  EXPECT_EQ(local.size, (Size{20, 11, 9}));
  EXPECT_EQ(local.type, ScalarType::kInt16);
  EXPECT_EQ(local.begin, static_cast<std::int64_t>(std::strlen(kMeta)));
  const ImageHeader detached =
      ParseMetaImageHeader(Replaced(kMeta, "LOCAL", "volume.raw\nHeaderSize = 9"));
  EXPECT_EQ(detached.data_file, "volume.raw");
  // The data file ends the header.
  EXPECT_EQ(detached.skip_bytes, 0);
}

TEST(MetaImageHeader, Compressed) {
  const ImageHeader header = ParseMetaImageHeader(
      Replaced(kMeta, "CompressedData = False", "CompressedData = True\nCompressedDataSize = 77"));
  EXPECT_TRUE(header.compressed);
  EXPECT_EQ(header.compressed_bytes, 77);
}

TEST(MetaImageHeader, AttacksAreRefused) {
  const std::vector<std::pair<std::string, std::string>> attacks = {
      {"NDims = 3\n", ""},
      {"NDims = 3", "NDims = 4000"},
      {"NDims = 3", "NDims = 2"},
      {"NDims = 3", "NDims = -3"},
      {"NDims = 3", "NDims = 3\nNDims = 3"},
      {"DimSize = 20 11 9\n", ""},
      {"DimSize = 20 11 9", "DimSize = 20 11"},
      {"DimSize = 20 11 9", "DimSize = 20 0 9"},
      {"DimSize = 20 11 9", "DimSize = 20 11 1"},
      {"DimSize = 20 11 9", "DimSize = -20 -11 9"},
      {"ElementSpacing = 1 1 1.5", "ElementSpacing = 1 1"},
      {"ElementSpacing = 1 1 1.5", "ElementSpacing = 1 1 0"},
      {"ElementSpacing = 1 1 1.5", "ElementSpacing = 1 1 -1"},
      {"ElementSpacing = 1 1 1.5", "ElementSpacing = 1 1 nan"},
      {"Offset = 0 0 0", "Offset = 0 0 inf"},
      {"TransformMatrix = 1 0 0 0 1 0 0 0 1", "TransformMatrix = 1 0 0 0 1 0 0 0 nan"},
      {"TransformMatrix = 1 0 0 0 1 0 0 0 1", "TransformMatrix = 1 0 0"},
      {"ElementType = MET_SHORT\n", ""},
      {"ElementType = MET_SHORT", "ElementType = MET_LONG_LONG"},
      {"ElementType = MET_SHORT", "ElementType = MET_FLOAT_ARRAY"},
      {"ElementType = MET_SHORT", "ElementType = MET_SHORT\nElementNumberOfChannels = 3"},
      {"BinaryData = True", "BinaryData = False"},
      {"LOCAL", "/etc/passwd"},
      {"LOCAL", "../x.raw"},
      {"LOCAL", "LIST"},
      {"LOCAL", "x%03d.raw 1 9 1"},
      {"ElementDataFile = LOCAL", "ElementDataFile ="},
      {"ElementDataFile = LOCAL\n", ""},
      {"Offset = 0 0 0", "no field"},
      {"Offset = 0 0 0", "Comment = " + std::string(2000, 'x')},
      {"Offset = 0 0 0", "HeaderSize = 100"},
  };
  for (const auto& [from, to] : attacks) {
    EXPECT_NE(Refusal([&] { ParseMetaImageHeader(Replaced(kMeta, from, to)); }), "")
        << from << " -> " << to;
  }
}

TEST(MetaImageHeader, EveryPrefixIsHandled) {
  const std::string text = kMeta;
  for (std::size_t length = 0; length < text.size(); ++length) {
    Refusal([&] { ParseMetaImageHeader(text.substr(0, length)); });
  }
}

// ---------------------------------------------------------------- NIfTI

class NiftiBytes {
 public:
  explicit NiftiBytes(bool swap = false) : bytes_(kNiftiHeaderBytes, '\0'), swap_(swap) {
    Put<std::int32_t>(0, 348);
    const std::int16_t dim[8] = {3, 20, 11, 9, 1, 1, 1, 1};
    for (int k = 0; k < 8; ++k) Put<std::int16_t>(40 + 2 * k, dim[k]);
    Put<std::int16_t>(70, 4);
    Put<std::int16_t>(72, 16);
    for (int k = 0; k < 8; ++k) Put<float>(76 + 4 * k, 1.0f);
    Put<float>(108, 352.0f);
    std::memcpy(bytes_.data() + 344, "n+1", 4);
  }

  template <typename Number>
  NiftiBytes& Put(std::size_t offset, Number number) {
    char bytes[sizeof(Number)];
    std::memcpy(bytes, &number, sizeof(Number));
    if (swap_) std::reverse(bytes, bytes + sizeof(Number));
    std::memcpy(bytes_.data() + offset, bytes, sizeof(Number));
    return *this;
  }
  std::string& bytes() { return bytes_; }

 private:
  std::string bytes_;
  bool swap_;
};

TEST(NiftiHeader, BothEndians) {
  for (const bool swap : {false, true}) {
    const ImageHeader header = ParseNiftiHeader(NiftiBytes(swap).bytes());
    EXPECT_EQ(header.size, (Size{20, 11, 9}));
    EXPECT_EQ(header.type, ScalarType::kInt16);
    EXPECT_EQ(header.skip_bytes, 352);
  }
}

TEST(NiftiHeader, AttacksAreRefused) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::function<void(NiftiBytes*)>> attacks = {
      [](auto* b) { b->template Put<std::int32_t>(0, 347); },
      [](auto* b) { b->template Put<std::int32_t>(0, 540); },
      [](auto* b) { b->bytes()[344] = 'x'; },
      [](auto* b) { b->bytes()[345] = 'i'; },
      [](auto* b) { b->template Put<std::int16_t>(40, 0); },
      [](auto* b) { b->template Put<std::int16_t>(40, 8); },
      [](auto* b) { b->template Put<std::int16_t>(40, 2); },
      [](auto* b) { b->template Put<std::int16_t>(42, -20); },
      [](auto* b) { b->template Put<std::int16_t>(46, 1); },
      [](auto* b) { b->template Put<std::int16_t>(40, 4).template Put<std::int16_t>(48, 2); },
      [](auto* b) { b->template Put<std::int16_t>(70, 128).template Put<std::int16_t>(72, 24); },
      [](auto* b) { b->template Put<std::int16_t>(70, 32).template Put<std::int16_t>(72, 64); },
      [](auto* b) { b->template Put<std::int16_t>(70, 1024).template Put<std::int16_t>(72, 64); },
      [](auto* b) { b->template Put<std::int16_t>(70, 999); },
      [](auto* b) { b->template Put<std::int16_t>(72, 8); },
      [](auto* b) { b->template Put<float>(80, 0.0f); },
      [](auto* b) { b->template Put<float>(84, -1.0f); },
      [nan](auto* b) { b->template Put<float>(88, nan); },
      [](auto* b) { b->template Put<float>(108, 0.0f); },
      [](auto* b) { b->template Put<float>(108, 352.5f); },
      [](auto* b) { b->template Put<float>(108, 1e30f); },
      [nan](auto* b) { b->template Put<float>(108, nan); },
      [nan](auto* b) { b->template Put<float>(112, nan); },
      [nan](auto* b) { b->template Put<std::int16_t>(252, 1).template Put<float>(256, nan); },
      [nan](auto* b) { b->template Put<std::int16_t>(254, 1).template Put<float>(284, nan); },
  };
  for (std::size_t k = 0; k < attacks.size(); ++k) {
    for (const bool swap : {false, true}) {
      NiftiBytes bytes(swap);
      attacks[k](&bytes);
      EXPECT_NE(Refusal([&] { ParseNiftiHeader(bytes.bytes()); }), "") << k;
    }
  }
  EXPECT_NE(Refusal([] { ParseNiftiHeader(NiftiBytes().bytes().substr(0, 347)); }), "");
}

// ---------------------------------------------------------------- all

TEST(ImageHeader, LimitsRefuseBeforeAllocation) {
  ImportLimits limits;
  EXPECT_EQ(CheckedVoxelBytes({20, 11, 9}, 2, limits), 20 * 11 * 9 * 2);
  const std::int64_t huge = std::numeric_limits<std::int64_t>::max();
  for (const Size size : {Size{huge, huge, huge}, Size{huge / 2, 2, 2}, Size{1 << 20, 1 << 20, 2},
                          Size{std::int64_t{1} << 31, 2, 2}, Size{1290, 1290, 1300}}) {
    try {
      CheckedVoxelBytes(size, 8, limits);
      ADD_FAILURE() << size[0];
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kTooLarge) << error.what();
    }
  }
  limits.max_memory_bytes = 1 << 20;
  EXPECT_THROW(CheckedVoxelBytes({100, 100, 100}, 1, limits), Error);
}

// Whatever the bytes, parsing ends in a header or an Error.
TEST(ImageHeader, FlippedBytesNeverEscapeAsAnythingElse) {
  std::mt19937 random(1);
  const std::string nifti = NiftiBytes().bytes();
  for (int run = 0; run < 20000; ++run) {
    std::string texts[3] = {kNrrd, kMeta, nifti};
    for (std::string& text : texts) {
      for (unsigned flips = 1 + random() % 4; flips > 0; --flips) {
        text[random() % text.size()] = static_cast<char>(random());
      }
    }
    Refusal([&] { ParseNrrdHeader(texts[0], random() % 2 == 0); });
    Refusal([&] { ParseMetaImageHeader(texts[1]); });
    Refusal([&] { ParseNiftiHeader(texts[2]); });
  }
}

}  // namespace
}  // namespace palpate
