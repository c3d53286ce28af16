#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "server/import/file_headers.h"
#include "server/import/image_header.h"
#include "tests/unit/import_refusal.h"

namespace palpate {
namespace {

using Size = std::array<std::int64_t, 3>;

using testing::Refusal;

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

TEST(NrrdHeader, EveryTypeHasItsNames) {
  const std::pair<ScalarType, std::vector<const char*>> types[] = {
      {ScalarType::kInt8, {"int8", "signed char"}},
      {ScalarType::kUint8, {"uint8", "uchar"}},
      {ScalarType::kInt16, {"int16", "short"}},
      {ScalarType::kUint16, {"uint16_t", "unsigned short"}},
      {ScalarType::kInt32, {"int32", "int"}},
      {ScalarType::kUint32, {"uint", "unsigned int"}},
      {ScalarType::kFloat32, {"float"}},
      {ScalarType::kFloat64, {"double"}},
  };
  for (const auto& [type, names] : types) {
    for (const char* name : names) {
      EXPECT_EQ(Nrrd(Replaced(kNrrd, "type: int16", std::string("type: ") + name)).type, type);
    }
  }
}

TEST(NrrdHeader, CarriageReturnsAndUnit) {
  const ImageHeader header = Nrrd(
      "NRRD0005\r\ntype: uchar\r\ndimension: 3\r\nsizes: 2 3 4\r\nencoding: gz\r\n"
      "sample units: \"HU\"\r\n\r\nxx");
  EXPECT_EQ(header.size, (Size{2, 3, 4}));
  EXPECT_EQ(header.unit, "HU");
  EXPECT_TRUE(header.compressed);
}

TEST(NrrdHeader, UnitsOfLength) {
  const std::pair<const char*, double> units[] = {
      {"mm", 1.0},  {"m", 1e3},     {"cm", 10.0},     {"um", 1e-3},    {"\u00b5m", 1e-3},
      {"nm", 1e-6}, {"inch", 25.4}, {"inches", 25.4}, {"Meters", 1e3}, {"micrometers", 1e-3},
      {"", 1.0}};
  for (const auto& [unit, mm] : units) {
    const std::string quoted = '"' + std::string(unit) + '"';
    // Of a space: a unit for each of its axes.
    const std::string all = quoted + " " + quoted + " " + quoted;
    const double step = 7.0 / mm;  // so that all are within the range of spacings
    const std::string in_space =
        Replaced(kNrrd, "spacings: 1 1 1.5",
                 "space: left-posterior-superior\nspace directions: (" + std::to_string(step) +
                     ",0,0) (0," + std::to_string(step) + ",0) (0,0," + std::to_string(2 * step) +
                     ")\nspace origin: (0,0," + std::to_string(step) + ")\nspace units: " + all);
    const ImageGeometry geometry = Nrrd(in_space).geometry;
    EXPECT_NEAR(geometry.spacing_mm.x(), 7.0, 1e-4) << unit;
    EXPECT_NEAR(geometry.spacing_mm.z(), 14.0, 1e-4) << unit;
    EXPECT_NEAR(geometry.origin_W_mm.z(), 7.0, 1e-4) << unit;
    // Of axes without a space.
    const std::string of_axes =
        Replaced(kNrrd, "spacings: 1 1 1.5",
                 "spacings: " + std::to_string(step) + " " + std::to_string(step) + " " +
                     std::to_string(step) + "\nunits: " + all);
    EXPECT_NEAR(Nrrd(of_axes).geometry.spacing_mm.y(), 7.0, 1e-4) << unit;
  }
  // Each axis may have its own.
  const Vec3 mixed =
      Nrrd(Replaced(kNrrd, "spacings: 1 1 1.5", "spacings: 1 1 1.5\nunits: \"mm\" \"cm\" um"))
          .geometry.spacing_mm;
  EXPECT_NEAR((mixed - Vec3(1.0, 10.0, 1.5e-3)).norm(), 0.0, 1e-12);
  for (const char* unit : {"parsec", "furlongs", "s", "mm/s"}) {
    const ImageHeader header =
        Nrrd(Replaced(kNrrd, "key:=value", "units: \"mm\" \"mm\" \"" + std::string(unit) + '"'));
    EXPECT_EQ(header.geometry.unknown_unit, unit);
  }
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
  };
  for (const auto& [from, to] : attacks) {
    const std::string header = Replaced(kNrrd, from, to);
    EXPECT_NE(Refusal([&] { Nrrd(header); }), "") << from << " -> " << to;
  }
}

const char kSeries[] =
    "NRRD0005\ntype: float\ndimension: 4\nspace: left-anterior-superior\nsizes: 20 11 9 7\n"
    "space directions: (0,2,0) (1,0,0) (0,0,3) none\nkinds: domain domain domain time\n"
    "space origin: (10,20,30)\nendian: big\nencoding: raw\n\n";

TEST(NrrdHeader, TimeSeries) {
  const ImageHeader header = Nrrd(kSeries);
  EXPECT_EQ(header.size, (Size{20, 11, 9}));
  EXPECT_EQ(header.frames, 7);
  EXPECT_TRUE(header.big_endian);
  const std::string list = Replaced(kSeries, "domain time", "domain list");
  EXPECT_EQ(Nrrd(list).frames, 7);
  const std::string timed =
      Replaced(Replaced(Replaced(kSeries, "superior", "superior-time"),
                        "(0,2,0) (1,0,0) (0,0,3) none", "(0,2,0,0) (1,0,0,0) (0,0,3,0) (0,0,0,5)"),
               "(10,20,30)", "(10,20,30,4)");
  EXPECT_EQ(Nrrd(timed).geometry.origin_W_mm, header.geometry.origin_W_mm);
}

TEST(NrrdHeader, HostileSeriesAreRefused) {
  const std::pair<const char*, const char*> attacks[] = {
      {"9 7", "9 -7"},
      {"9 7", "9 0"},
      {"9 7", "9 2147483648"},
      {"9 7", "9 9223372036854775807"},
      {"9 7", "9 9223372036854775808"},
      {"domain time", "domain domain"},
      {"domain time", "domain"},
      {"kinds: domain", "kinds: vector"},
      {"kinds: domain domain domain time\n", ""},
      {"dimension: 4", "dimension: 5"},
      {"(0,2,0)", "(0,2,0,1)"},
      {"(0,2,0)", "(0,2)"},
      {"(0,2,0)", "none"},
      {"(10,20,30)", "(10,20)"},
  };
  for (const auto& [from, to] : attacks) {
    const std::string header = Replaced(kSeries, from, to);
    EXPECT_NE(Refusal([&] { Nrrd(header); }), "") << from << " -> " << to;
  }
  const std::string five =
      Replaced(Replaced(kSeries, "9 7", "9 7 2"), "dimension: 4", "dimension: 5");
  EXPECT_NE(Refusal([&] { Nrrd(five); }).find("more than three"), std::string::npos);
}

TEST(NrrdHeader, GeometryInLps) {
  const ImageGeometry las = Nrrd(kSeries).geometry;
  EXPECT_EQ(las.spacing_mm, Vec3(2, 1, 3));
  // Left and superior are as in LPS; anterior is turned.
  EXPECT_EQ(las.origin_W_mm, Vec3(10, -20, 30));
  Mat3 direction;
  direction << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  EXPECT_EQ(las.direction, direction);
  EXPECT_EQ(Nrrd(Replaced(kSeries, "left-ant", "right-ant")).geometry.origin_W_mm,
            Vec3(-10, -20, 30));
  EXPECT_EQ(Nrrd(Replaced(kSeries, "left-anterior-superior", "LPST")).geometry.origin_W_mm,
            Vec3(10, 20, 30));
}

TEST(NrrdHeader, OnlyAnatomicalSpacesSayWhereTheyLieInAPatient) {
  const auto is_lps = [](const char* space) {
    return Nrrd(Replaced(kSeries, "space: left-anterior-superior", space)).geometry.is_lps;
  };
  for (const char* space : {"space: left-anterior-superior", "space: Right-Anterior-Superior",
                            "space: LPS", "space: RAST", "space: left-posterior-superior-time"}) {
    EXPECT_TRUE(is_lps(space)) << space;
  }
  for (const char* space :
       {"space: scanner-xyz", "space: 3D-right-handed", "space dimension: 3", "# no space"}) {
    EXPECT_FALSE(is_lps(space)) << space;
  }
  EXPECT_FALSE(Nrrd(kNrrd).geometry.is_lps);
  // Of the axes of the index, nothing says where they lie in the space.
  EXPECT_FALSE(Nrrd(Replaced(kNrrd, "key:=value", "space: LPS")).geometry.is_lps);
}

TEST(NrrdHeader, GeometryWithoutSpace) {
  EXPECT_EQ(Nrrd(kNrrd).geometry.spacing_mm, Vec3(1, 1, 1.5));
  EXPECT_EQ(Nrrd(kNrrd).geometry.origin_W_mm, Vec3::Zero());
  const std::string placed = Replaced(kNrrd, "key:=value", "axis mins: 1 2 3\ncenters: cell node");
  for (const std::string& header : {placed, Replaced(placed, "centers", "centerings")}) {
    EXPECT_EQ(Nrrd(header).geometry.origin_W_mm, Vec3(1.5, 2, 3.75));
  }
  const std::string ranged = Replaced(placed, "spacings: 1 1 1.5", "axis maxs: 21 22 21");
  EXPECT_EQ(Nrrd(ranged).geometry.spacing_mm, Vec3(1, 2, 2));
  EXPECT_EQ(Nrrd(ranged).geometry.origin_W_mm, Vec3(1.5, 2, 4));
}

// Slicer lists what is known of a segment behind one key.
TEST(NrrdHeader, KeysOfAnyLengthAreIgnored) {
  for (const std::size_t length : {4000, 6000, 900'000}) {
    const std::string value(length, 'x');
    EXPECT_EQ(Nrrd(Replaced(kNrrd, "key:=value", "key:=" + value)).size, (Size{20, 11, 9}));
    EXPECT_EQ(Nrrd(Replaced(kNrrd, "# comment", "# " + value)).size, (Size{20, 11, 9}));
  }
}

TEST(NrrdHeader, ANegativeSpacingTurnsItsAxisAroundAndAMissingOneIsSaid) {
  const ImageHeader turned = Nrrd(Replaced(kNrrd, "spacings: 1 1 1.5", "spacings: 1 -2 1.5"));
  EXPECT_EQ(turned.geometry.spacing_mm, Vec3(1, 2, 1.5));
  EXPECT_EQ(turned.geometry.direction.diagonal(), Vec3(1, -1, 1));
  EXPECT_EQ(turned.warnings.size(), 1u);
  const std::string negative = Replaced(kNrrd, "spacings: 1 1 1.5", "spacings: 1 -2 1.5");
  EXPECT_EQ(ParseNrrdHeader(negative, true, true).geometry.direction(1, 1), -1.0);
  for (const char* const unknown : {"spacings: 1 nan 1.5", "content: none"}) {
    const std::string header = Replaced(kNrrd, "spacings: 1 1 1.5", unknown);
    EXPECT_EQ(Nrrd(header).warnings.size(), 1u) << unknown;
    EXPECT_EQ(Nrrd(header).geometry.spacing_mm.y(), 1.0);
    EXPECT_TRUE(ParseNrrdHeader(header, true, true).warnings.empty());
  }
}

TEST(NrrdHeader, AStatedSpacingComesBeforeTheFiles) {
  for (const char* broken : {"0 1 1", "inf 1 1"}) {
    const std::string header = Replaced(kNrrd, "spacings: 1 1", std::string("spacings: ") + broken);
    EXPECT_NE(Refusal([&] { Nrrd(header); }).find("--spacing-mm"), std::string::npos);
    EXPECT_EQ(ParseNrrdHeader(header, true, true).geometry.spacing_mm, Vec3::Ones());
  }
}

TEST(NrrdHeader, VectorsAndUnnamedSeriesAreRefused) {
  const std::string four = Replaced(kNrrd, "dimension: 3", "dimension: 4");
  EXPECT_NE(Refusal([&] { Nrrd(Replaced(four, "20 11 9", "20 11 9 7")); }).find("more than three"),
            std::string::npos);
  EXPECT_NE(Refusal([&] {
              Nrrd(Replaced(Replaced(four, "20 11 9", "3 20 11 9"), "key:=value",
                            "kinds: RGB-color domain domain domain"));
            }).find("several values"),
            std::string::npos);
}

// ---------------------------------------------------------------- MetaImage

const char kMeta[] =
    "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
    "CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n"
    "ElementSpacing = 1 1 1.5\nDimSize = 20 11 9\nElementType = MET_SHORT\n"
    "ElementDataFile = LOCAL\n";

TEST(MetaImageHeader, LocalDetachedAndCompressed) {
  const ImageHeader local = ParseMetaImageHeader(std::string(kMeta) + "\x01\x02");
  EXPECT_EQ(local.size, (Size{20, 11, 9}));
  EXPECT_EQ(local.type, ScalarType::kInt16);
  EXPECT_EQ(local.begin, static_cast<std::int64_t>(std::strlen(kMeta)));
  const ImageHeader detached =
      ParseMetaImageHeader(Replaced(kMeta, "LOCAL", "volume.raw\nHeaderSize = 9"));
  EXPECT_EQ(detached.data_file, "volume.raw");
  // The data file ends the header.
  EXPECT_EQ(detached.skip_bytes, 0);
  const ImageHeader packed = ParseMetaImageHeader(
      Replaced(kMeta, "CompressedData = False", "CompressedData = True\nCompressedDataSize = 77"));
  EXPECT_TRUE(packed.compressed);
  EXPECT_EQ(packed.compressed_bytes, 77);
  // As MetaIO: voxels at the file's end, or behind so many bytes of it.
  const auto with_size = [](const std::string& size) {
    return ParseMetaImageHeader(
        Replaced(kMeta, "Offset = 0 0 0", "Offset = 0 0 0\nHeaderSize = " + size));
  };
  EXPECT_EQ(with_size("-1").skip_bytes, ImageHeader::kVoxelsAtEnd);
  EXPECT_EQ(with_size("4096").begin, 4096);
  const std::string uncounted =
      "CompressedData = True\nCompressedDataSize = 0\nComment = a\nComment = b";
  EXPECT_EQ(
      ParseMetaImageHeader(Replaced(kMeta, "CompressedData = False", uncounted)).compressed_bytes,
      ImageHeader::kToFileEnd);
}

TEST(MetaImageHeader, PlaceAndByteOrder) {
  const std::string header =
      Replaced(Replaced(kMeta, "Offset = 0 0 0", "Position = 1 -2 3"),
               "TransformMatrix = 1 0 0 0 1 0 0 0 1", "Rotation = 0 1 0 -1 0 0 0 0 1");
  const ImageGeometry geometry = ParseMetaImageHeader(header).geometry;
  EXPECT_EQ(geometry.origin_W_mm, Vec3(1, -2, 3));
  EXPECT_EQ(geometry.spacing_mm, Vec3(1, 1, 1.5));
  EXPECT_EQ(geometry.direction.col(0), Vec3(0, 1, 0));
  EXPECT_EQ(geometry.direction.col(1), Vec3(-1, 0, 0));
  EXPECT_FALSE(ParseMetaImageHeader(kMeta).big_endian);
  EXPECT_TRUE(ParseMetaImageHeader(Replaced(kMeta, "MSB = False", "MSB = True")).big_endian);
  const std::string broken = Replaced(kMeta, "1 1 1.5", "1 0 -1");
  EXPECT_EQ(ParseMetaImageHeader(broken, true).geometry.spacing_mm, Vec3::Ones());
}

// Libraries with buffers of fixed length crash.
TEST(MetaImageHeader, LinesOfAnyLength) {
  for (const char* name : {"Comment", "Name", "AnatomicalOrientation", "Own"}) {
    for (const std::size_t length : {255, 400, 501, 500'000}) {
      const std::string line = name + std::string(" = ") + std::string(length, 'x') + "\nNDims";
      EXPECT_EQ(ParseMetaImageHeader(Replaced(kMeta, "NDims", line)).size, (Size{20, 11, 9}));
    }
  }
}

TEST(MetaImageHeader, AnAnatomicalOrientationPlacesItInAPatient) {
  const auto is_lps = [](const std::string& lines) {
    return ParseMetaImageHeader(Replaced(kMeta, "NDims", lines + "NDims")).geometry.is_lps;
  };
  EXPECT_TRUE(is_lps("AnatomicalOrientation = RAI\n"));
  EXPECT_FALSE(is_lps("AnatomicalOrientation = ???\n"));
  EXPECT_FALSE(is_lps("AnatomicalOrientation = RAS\n")) << "its TransformMatrix says RAI";
  EXPECT_FALSE(is_lps("")) << "a TransformMatrix alone";
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
      {"ElementSpacing = 1 1 1.5", "ElementSpacing = 1 1 nan"},
      {"ElementSpacing = 1 1 1.5", "ElementSpacing ="},
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
      {"Offset = 0 0 0", "HeaderSize = 100"},
  };
  for (const auto& [from, to] : attacks) {
    const std::string header = Replaced(kMeta, from, to);
    EXPECT_NE(Refusal([&] { ParseMetaImageHeader(header); }), "") << from << " -> " << to;
  }
}

// ---------------------------------------------------------------- all

TEST(ImageHeader, LimitsRefuseBeforeAllocation) {
  ImportLimits limits;
  EXPECT_EQ(CheckedVoxelBytes({20, 11, 9}, ScalarType::kInt16, LeafType::kInt16, limits),
            20 * 11 * 9 * 2);
  const std::int64_t huge = std::numeric_limits<std::int64_t>::max();
  for (const Size size : {Size{huge, huge, huge}, Size{huge / 2, 2, 2}, Size{1 << 20, 1 << 20, 2},
                          Size{std::int64_t{1} << 31, 2, 2}, Size{1290, 1290, 1300}}) {
    try {
      CheckedVoxelBytes(size, ScalarType::kFloat64, LeafType::kFloat, limits);
      ADD_FAILURE() << size[0];
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kTooLarge) << error.what();
    }
  }
  limits.max_memory_bytes = 1 << 20;
  const std::string said = Refusal([&] {
    CheckedVoxelBytes({100, 100, 20}, ScalarType::kFloat64, LeafType::kFloat, limits);
  });
  EXPECT_NE(said.find("3 MiB"), std::string::npos) << said;  // 2.3
}

TEST(ImageHeader, BytesNeedLessMemoryThanFloats) {
  ImportLimits limits;
  limits.max_memory_bytes = 1 << 20;
  const Size size = {100, 100, 16};
  EXPECT_EQ(CheckedVoxelBytes(size, ScalarType::kUint8, LeafType::kUint8, limits), 160'000);
  EXPECT_NE(Refusal([&] { CheckedVoxelBytes(size, ScalarType::kUint8, LeafType::kFloat, limits); }),
            "");
}

}  // namespace
}  // namespace palpate
