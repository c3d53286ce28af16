// TIFF stacks: layouts, series of files, and attacks.
#include "server/import/tiff_stack.h"

#include <fstream>

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.h"
#include "tests/support/tiff_writer.h"
#include "tests/unit/collected_voxels.h"
#include "tests/unit/import_refusal.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using testing::CollectedVoxels;
using testing::Refusal;
using testing::TiffLayout;
using testing::WriteTiff;

int Value(int x, int y, int z) { return (11 * x + 23 * y + 37 * z) % 121; }

class TiffStackTest : public ::testing::Test {
 protected:
  template <typename Number = std::uint16_t>
  fs::path Stack(const std::string& name, const TiffLayout& layout = {}) const {
    WriteTiff<Number>(folder_.path() / name, layout, Value);
    return folder_.path() / name;
  }

  // One page, slice z of the pattern.
  fs::path Slice(const std::string& name, int z, TiffLayout layout = {}) const {
    layout.pages = 1;
    fs::create_directories((folder_.path() / name).parent_path());
    WriteTiff<std::uint16_t>(folder_.path() / name, layout,
                             [z](int x, int y, int) { return Value(x, y, z); });
    return folder_.path() / name;
  }

  std::string RefusalOf(const fs::path& input) const {
    return Refusal([&] { Read(input); });
  }
  void ExpectRefused(const std::string& name, const std::string& text) const {
    const std::string what = RefusalOf(folder_.path() / name);
    EXPECT_NE(what.find(text), std::string::npos) << name << ": " << what;
  }

  static void Read(const fs::path& input) {
    ImportLimits limits;
    limits.max_voxels = 1 << 20;
    ReadTiffVoxels(
        OpenTiffStack(input, limits), [](double) {}, [](LeafType, const void*, std::size_t) {});
  }

  test::TemporaryFolder folder_;
};

void ExpectPattern(const fs::path& input, ScalarType type = ScalarType::kUint16,
                   const TiffLayout& layout = {}, int slices = 4) {
  const TiffStack stack = OpenTiffStack(input, {});
  EXPECT_EQ(stack.header.type, type);
  const std::array<std::int64_t, 3> size = {layout.width, layout.height, slices};
  ASSERT_EQ(stack.header.size, size);
  double last = 0.0;
  CollectedVoxels voxels;
  ReadTiffVoxels(
      stack, [&](double fraction) { last = fraction; }, voxels.Sink());
  EXPECT_EQ(last, 1.0);
  EXPECT_EQ(voxels.type, LeafTypeNamed(Name(type)).value_or(LeafType::kFloat));
  std::size_t at = 0;
  for (int z = 0; z < slices; ++z) {
    for (int y = 0; y < static_cast<int>(layout.height); ++y) {
      for (int x = 0; x < static_cast<int>(layout.width); ++x) {
        ASSERT_EQ(voxels.values.at(at++), Value(x, y, z)) << x << " " << y << " " << z;
      }
    }
  }
}

// ---------------------------------------------------------------- what is read

TEST_F(TiffStackTest, EveryTypeAndByteOrder) {
  for (const char* mode : {"wl", "wb", "wl8", "wb8"}) {
    SCOPED_TRACE(mode);
    TiffLayout layout{.mode = mode};
    ExpectPattern(Stack("u16.tif", layout), ScalarType::kUint16);
    layout.format = SAMPLEFORMAT_INT;
    ExpectPattern(Stack<std::int16_t>("i16.tif", layout), ScalarType::kInt16);
    layout.bits = 8;
    ExpectPattern(Stack<std::int8_t>("i8.tif", layout), ScalarType::kInt8);
    layout.format = SAMPLEFORMAT_UINT;
    ExpectPattern(Stack<std::uint8_t>("u8.tiff", layout), ScalarType::kUint8);
    layout.format = SAMPLEFORMAT_IEEEFP;
    layout.bits = 32;
    ExpectPattern(Stack<float>("f32.tif", layout), ScalarType::kFloat32);
  }
}

TEST_F(TiffStackTest, StripsTilesAndCompressions) {
  for (const std::uint16_t compression :
       {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS}) {
    for (const std::uint32_t tile : {0u, 16u}) {
      for (const std::uint32_t rows : {1u, 4u, 1000u}) {
        SCOPED_TRACE(std::to_string(compression) + " " + std::to_string(tile) + " " +
                     std::to_string(rows));
        const TiffLayout layout{.width = 37,
                                .height = 21,
                                .compression = compression,
                                .rows_per_strip = rows,
                                .tile = tile};
        ExpectPattern(Stack("a.tif", layout), ScalarType::kUint16, layout);
      }
    }
  }
}

TEST_F(TiffStackTest, ReducedImagesAreLeftOut) {
  const TiffLayout layout{.pages = 5, .subfile_type = FILETYPE_REDUCEDIMAGE};
  ExpectPattern(Stack("a.tif", layout));
}

TEST_F(TiffStackTest, NumberedFiles) {
  // By number, not by letter; the last number counts.
  for (int z = 0; z < 4; ++z) Slice("s/ct2_" + std::to_string(z + 8) + "_raw.tif", z);
  std::ofstream(folder_.path() / "s" / ".hidden") << "x";
  std::ofstream(folder_.path() / "s" / "notes.txt") << "x";
  EXPECT_TRUE(IsTiffFolder(folder_.path() / "s"));
  ExpectPattern(folder_.path() / "s");
  ExpectPattern(folder_.path() / "s" / "ct2_8_raw.tif");
  Slice("s/other_1.tif", 0);
  ExpectPattern(folder_.path() / "s" / "ct2_8_raw.tif");
  ExpectRefused("s", "different series");
}

TEST_F(TiffStackTest, FoldersWithAndWithoutAStack) {
  fs::create_directory(folder_.path() / "s");
  EXPECT_FALSE(IsTiffFolder(folder_.path() / "s"));
  Stack("s/a.tif");
  ExpectPattern(folder_.path() / "s");
  std::ofstream(folder_.path() / "s" / "IM0001") << "x";
  EXPECT_FALSE(IsTiffFolder(folder_.path() / "s"));
}

TEST_F(TiffStackTest, TheSpacingOfImageJAndOme) {
  const auto spacing = [this](const std::string& description, float per_unit = 4.0f) {
    const TiffStack stack =
        OpenTiffStack(Stack("a.tif", {.description = description, .per_unit = per_unit}), {});
    return stack.states_spacing ? stack.header.geometry.spacing_mm : Vec3::Zero();
  };
  const std::string image_j = "ImageJ=1.53t\nimages=4\nslices=4\nspacing=2.0\n";
  for (const char* unit : {"micron", "um", "\\u00B5m", "\xb5m", "\u00b5m"}) {
    EXPECT_TRUE(spacing(image_j + "unit=" + unit + "\n").isApprox(Vec3(0.25e-3, 0.25e-3, 2e-3)));
  }
  EXPECT_TRUE(spacing(image_j + "unit=cm\n").isApprox(Vec3(2.5, 2.5, 20)));
  EXPECT_TRUE(spacing(image_j + "unit=mm\nyunit=cm\nzunit=um\n").isApprox(Vec3(0.25, 2.5, 2e-3)));
  EXPECT_TRUE(spacing("ImageJ=1.53t\nimages=4\nunit=mm\n").isApprox(Vec3(0.25, 0.25, 1)));
  const std::string ome =
      "<OME><Image><Pixels SizeX=\"7\" SizeC=\"1\" PhysicalSizeX=\"3\" PhysicalSizeY='4' ";
  const std::string end = "/></Image></OME>";
  EXPECT_TRUE(spacing(ome + "PhysicalSizeZ=\"5\"" + end).isApprox(Vec3(3e-3, 4e-3, 5e-3)));
  EXPECT_TRUE(spacing(ome + "PhysicalSizeZ=\n'5' PhysicalSizeZUnit=\"mm\"" + end)
                  .isApprox(Vec3(3e-3, 4e-3, 5)));
  // A part of it is none.
  for (const std::string& none :
       {image_j, image_j + "unit=pixel\n", ome + end, std::string("ImageJ=1\nunit=um\n"),
        ome + "PhysicalSizeZ=\"x\"" + end, ome + "PhysicalSizeZ=\"-5\"" + end,
        ome + "PhysicalSizeZ=\"5\"/>",
        "<!-- " + ome + "PhysicalSizeZ=\"5\"" + end + " --><OME/>"}) {
    EXPECT_TRUE(spacing(none).isZero()) << none;
  }
  EXPECT_TRUE(spacing(image_j + "unit=um\n", 0.0f).isZero());
}

TEST_F(TiffStackTest, TheCalibrationOfImageJGivesTheValues) {
  const auto read = [this](const std::string& calibration, bool is_given) {
    const std::string text = "ImageJ=1.53t\nimages=4\nslices=4\n" + calibration;
    const TiffStack stack = OpenTiffStack(Stack("a.tif", {.description = text}), {});
    EXPECT_EQ(stack.header.warnings.size(), is_given) << calibration;
    CollectedVoxels voxels;
    ReadTiffVoxels(
        stack, [](double) {}, voxels.Sink());
    return std::pair(stack.header.unit, voxels.values.at(37) - Value(2, 0, 1));
  };
  const auto is = [](const char* unit, float shift) { return std::pair(std::string(unit), shift); };
  EXPECT_EQ(read("c0=-32768\nc1=1\nvunit=HU\n", true), is("HU", -32768.0f));
  EXPECT_EQ(read("cf=0\nc0=7\nc1=1.0E0\nvunit=Gray Value\n", true), is("", 7.0f));
  EXPECT_EQ(read("cf=0\nc0=0.0\nc1=1.0\n", false), is("", 0.0f));
  EXPECT_EQ(read("cf=20\nc0=7\nc1=1\n", false), is("", 0.0f));
  EXPECT_EQ(read("cf=4\nc0=7\nc1=1\n", true), is("", 0.0f));  // no straight line
  // Files of one slice each, of which one is calibrated otherwise.
  Slice("s/a1.tif", 0);
  Slice("s/a2.tif", 1, {.description = "ImageJ=1.53t\nc0=-32768\nc1=1\n"});
  ExpectRefused("s", "calibration");
}

TEST_F(TiffStackTest, OmeOrdersThePages) {
  const auto ome = [](const std::string& planes, const std::string& after = "") {
    return "<?xml version='1.0'?><o:OME xmlns:o='x'><o:Image><o:Pixels SizeZ='4' SizeC='1' "
           "SizeT='1'>" +
           planes + "</o:Pixels></o:Image>" + after + "</o:OME>";
  };
  const std::string planes =
      "<o:TiffData FirstZ='2' IFD='0' PlaneCount='2'/><o:TiffData FirstZ='0' IFD='2'/>"
      "<o:TiffData FirstZ='1' IFD='3'/>";
  const auto stack = OpenTiffStack(Stack("a.tif", {.description = ome(planes)}), {});
  EXPECT_EQ(stack.pages, (std::vector<std::uint32_t>{2, 3, 0, 1}));
  EXPECT_EQ(stack.header.warnings.size(), 1u);
  CollectedVoxels voxels;
  ReadTiffVoxels(
      stack, [](double) {}, voxels.Sink());
  for (int z = 0; z < 4; ++z) {
    EXPECT_EQ(voxels.values.at(static_cast<std::size_t>(35 * z)), Value(0, 0, (z + 2) % 4));
  }
  ExpectPattern(Stack("b.tif", {.description = ome("<o:TiffData/>")}));
  const auto refused = [&](const std::string& description, const std::string& text) {
    Stack("c.tif", {.description = description});
    ExpectRefused("c.tif", text);
  };
  refused(ome("<o:TiffData IFD='0'/>"), "other slices");
  refused(
      ome("<o:TiffData><o:UUID FileName='d.tif'/></o:TiffData><o:TiffData IFD='3' FirstZ='3'/>"),
      "other files");
  refused(ome(planes, "<o:Image><o:Pixels/></o:Image>"), "2 images");
}

// The pages of files above 4 GB have no directories of their own.
TEST_F(TiffStackTest, OfImageJTheFirstPageStandsForAll) {
  const fs::path path = folder_.path() / "a.tif";
  const std::string description = "ImageJ=1.53t\nimages=4\nslices=4\n";
  for (const bool big : {false, true}) {
    std::string bytes = big ? "MM" : "II";
    const auto put = [&](std::uint32_t value, int count) {
      for (int k = 0; k < count; ++k) {
        bytes += static_cast<char>(value >> (8 * (big ? count - 1 - k : k)) & 0xff);
      }
    };
    const auto entry = [&](std::uint32_t tag, std::uint32_t type, std::uint32_t count,
                           std::uint32_t value) {
      for (const std::uint32_t number : {tag, type}) put(number, 2);
      for (const std::uint32_t number : {count, value}) put(number, 4);
    };
    put(42, 2), put(8, 4), put(9, 2);
    const std::uint32_t end = 8 + 2 + 9 * 12 + 4;
    const auto length = static_cast<std::uint32_t>(description.size() + 1);
    entry(256, 4, 1, 7), entry(257, 4, 1, 5), entry(258, 4, 1, 16), entry(259, 4, 1, 1);
    entry(262, 4, 1, 1), entry(270, 2, length, end), entry(273, 4, 1, end + length);
    entry(278, 4, 1, 5), entry(279, 4, 1, 70);
    put(0, 4);
    bytes += description + std::string(1, '\0');
    for (int n = 0; n < 4 * 35; ++n) {
      put(static_cast<std::uint32_t>(Value(n % 7, n / 7 % 5, n / 35)), 2);
    }
    std::ofstream(path, std::ios::binary) << bytes;
    ExpectPattern(path);
    std::ofstream(path, std::ios::binary) << bytes.substr(0, bytes.size() - 1);
    ExpectRefused("a.tif", "ImageJ");
  }
}

// ---------------------------------------------------------------- what is refused

TEST_F(TiffStackTest, GapsAndDoubleNumbers) {
  Slice("s/a001.tif", 0);
  Slice("s/a002.tif", 1);
  Slice("s/a005.tif", 2);
  for (const char* input : {"s", "s/a001.tif"}) {
    ExpectRefused(input, "2 slices are missing between 'a002.tif' and 'a005.tif'");
  }
  Slice("d/a1.tif", 0);
  Slice("d/a01.tif", 1);
  ExpectRefused("d", "same number");
  Slice("e/a1.tif", 0);
  Slice("e/a2.tif", 1);
  ExpectRefused("e/a2.tif", "give 'a1.tif'");
  Slice("f/first.tif", 0);
  Slice("f/second.tif", 1);
  ExpectRefused("f", "number");
  ExpectRefused("f/first.tif", "one slice");
}

TEST_F(TiffStackTest, MixedSlices) {
  Slice("s/a1.tif", 0);
  Slice("s/a2.tif", 1, {.width = 8});
  ExpectRefused("s", "'a2.tif': it is 8x5 uint16 where the first is 7x5");
  Slice("s/a2.tif", 1, {.format = SAMPLEFORMAT_INT});
  ExpectRefused("s", "one size and type");
  fs::remove(folder_.path() / "s" / "a2.tif");
  Stack("s/a2.tif");
  ExpectRefused("s", "several pages");
}

TEST_F(TiffStackTest, ColourAndOddTypes) {
  const auto refused = [this](const TiffLayout& layout, const std::string& text) {
    Stack<std::uint32_t>("a.tif", layout);
    ExpectRefused("a.tif", text);
  };
  refused({.bits = 8, .samples = 3, .photometric = PHOTOMETRIC_RGB}, "colour");
  refused({.bits = 16, .samples = 2}, "colour");
  refused({.bits = 1}, "1 bits");
  refused({.bits = 4}, "4 bits");
  refused({.bits = 16, .format = SAMPLEFORMAT_IEEEFP}, "16 bits");
  refused({.bits = 16, .format = SAMPLEFORMAT_COMPLEXINT}, "16 bits");
  refused({.description = "ImageJ=1.53t\nimages=4\nchannels=2\nslices=2\n"}, "channels");
  refused({.description = "ImageJ=1.53t\nimages=4\nframes=12\n"}, "times");
  refused({.description = "<OME><Image><Pixels SizeC='2' SizeZ='2'/></Image></OME>"}, "channels");
  refused({.pages = 1}, "one slice");
  refused({.width = 1}, "two");
  ExpectPattern(Stack("b.tif", {.description = "ImageJ=1.53t\nimages=4\nchannels=1\nslices=4\n"}));
}

TEST_F(TiffStackTest, LimitsHoldForTheWholeStack) {
  const fs::path path = Stack("a.tif");
  ImportLimits limits;
  limits.max_voxels = 7 * 5 * 4;
  EXPECT_NO_THROW(OpenTiffStack(path, limits));
  limits.max_voxels -= 1;
  EXPECT_NE(Refusal([&] { OpenTiffStack(path, limits); }).find("limit"), std::string::npos);
}

TEST_F(TiffStackTest, EveryTruncationIsRefused) {
  for (const std::uint16_t compression : {COMPRESSION_NONE, COMPRESSION_LZW}) {
    const std::string whole = test::TextOf(Stack("a.tif", {.compression = compression}));
    const fs::path cut = folder_.path() / "cut.tif";
    for (std::size_t length = 0; length < whole.size(); ++length) {
      std::ofstream(cut, std::ios::binary) << whole.substr(0, length);
      EXPECT_NE(RefusalOf(cut), "") << length << " of " << whole.size();
    }
  }
}

std::uint32_t Little(const std::string& bytes, std::size_t at, int count) {
  std::uint32_t value = 0;
  for (int k = 0; k < count; ++k) {
    value |= std::uint32_t{static_cast<unsigned char>(bytes.at(at + k))} << (8 * k);
  }
  return value;
}

// Where the last page's offset of a next page stands.
std::size_t LastLink(const std::string& bytes) {
  for (std::size_t link = 4;;) {
    const std::uint32_t page = Little(bytes, link, 4);
    if (page == 0) return link;
    link = page + 2 + 12 * Little(bytes, page, 2);
  }
}

TEST_F(TiffStackTest, DamagedLinksBetweenPagesAreRefused) {
  const std::string whole = test::TextOf(Stack("a.tif"));
  const std::size_t link = LastLink(whole);
  const std::string to_first = whole.substr(4, 4);
  for (const std::string& next : {to_first, std::string("\xff\xff\xff\x7f"), std::string(4, 1)}) {
    std::string bytes = whole;
    bytes.replace(link, 4, next);
    std::ofstream(folder_.path() / "b.tif", std::ios::binary) << bytes;
    ExpectRefused("b.tif", "page 5");
  }
}

}  // namespace
}  // namespace palpate
