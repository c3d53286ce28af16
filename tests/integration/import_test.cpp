// palpate-import on small files of every format but .vdb and DICOM, and the program itself. What
// their headers may hold is tested with the parsers, in tests/unit/import_*_test.cpp.
#include <algorithm>
#include <chrono>
#include <functional>
#include <limits>

#include "tests/integration/image_bytes.h"
#include "tests/integration/import_support.h"
#include "tests/support/deflated.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/tiff_writer.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using testing::Deflated;

constexpr ErrorKind kInvalid = ErrorKind::kInvalidArgument;

std::string Nrrd(const std::string& data, const std::string& encoding = "raw",
                 const std::string& type = "int16", const std::string& more = "",
                 const std::string& spacings = "0.5 0.75 2") {
  return "NRRD0004\ntype: " + type + "\ndimension: 3\nsizes: 7 5 4\nspacings: " + spacings +
         "\nendian: little\nencoding: " + encoding + "\n" + more + "\n" + data;
}

std::string Meta(const std::string& data, const std::string& more = "",
                 const std::string& type = "MET_SHORT", bool big = false,
                 const std::string& file = "LOCAL") {
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = " +
         std::string(big ? "True" : "False") + "\n" + more +
         "Offset = 1 2 3\nElementSpacing = 0.5 0.75 2\nDimSize = 7 5 4\nElementType = " + type +
         "\nElementDataFile = " + file + "\n" + data;
}

std::string PackedMeta(const std::string& packed) {
  return Meta(packed, "CompressedData = True\nCompressedDataSize = " +
                          std::to_string(packed.size()) + "\n");
}

std::string Nifti(const std::string& data) {
  return NiftiBytes({7, 5, 4}, {Vec3(0.5, 0.75, 2.0).asDiagonal(), {10.0, 20.0, 30.0}}, data);
}

void ExpectSpacing(const LoadedVolume& volume) {
  EXPECT_TRUE(volume.metadata.spacing_mm.isApprox(Vec3(0.5, 0.75, 2), 1e-6))
      << volume.metadata.spacing_mm.transpose();
}

// ---------------------------------------------------------------- what is read

// A map's coordinates, in mm.
TEST_F(ImportTest, OriginsMayBeFarAway) {
  std::string far = Meta(PatternBytes<std::int16_t>());
  far.replace(far.find("1 2 3"), 5, "408201585 4080928017 312250.5");
  EXPECT_EQ(Imported(Write("a.mha", far)).metadata.origin_W_mm,
            Vec3(408201585, 4080928017, 312250.5));
  far.replace(far.find("408201585"), 9, "1e13");
  ExpectRefused(Write("b.mha", far), kInvalid, "1e12 mm");
}

// Of a ball, in mm, in voxels, or of one of its halves alone.
TEST_F(ImportTest, DistancesAreFeltFromOutside) {
  static constexpr int kEdge = 24;
  const auto imported = [this](const std::function<double(const Vec3& p_mm)>& value) {
    std::string voxels;
    testing::ForEachVoxel(Vec3i::Constant(kEdge), [&](const Vec3i& p) {
      voxels += BytesOf(static_cast<float>(value(0.5 * (p.cast<double>().array() - 11.3))));
    });
    const std::string header =
        "NRRD0004\ntype: float\ndimension: 3\nsizes: 24 24 24\n"
        "spacings: 0.5 0.5 0.5\nendian: little\nencoding: raw\n\n";
    return Imported(Write("a.nrrd", header + voxels)).metadata.is_level_set;
  };
  const auto ball = [](const Vec3& p) { return Vec3(p.z(), p.y(), p.x()).norm() - 3.0; };
  EXPECT_TRUE(imported(ball));
  EXPECT_EQ(warnings_.size(), 1u);
  // Also once it is converted.
  test::Process({test::kPalpateImport, Path("a.nrrd"), Path("a.vdb")}, std::chrono::seconds(60))
      .Wait();
  EXPECT_TRUE(Imported(Path("a.vdb")).metadata.is_level_set);
  EXPECT_TRUE(warnings_.empty());
  EXPECT_TRUE(imported([&](const Vec3& p) { return 2.0 * ball(p); }));
  EXPECT_TRUE(imported([&](const Vec3& p) { return std::clamp(ball(p), -1.5, 1.5); }));
  EXPECT_FALSE(imported([&](const Vec3& p) { return -ball(p); }));
  EXPECT_NE(warnings_.at(0).find("negative outside"), std::string::npos);
  EXPECT_FALSE(imported([](const Vec3& p) { return p.z(); }));
  EXPECT_NE(warnings_.at(0).find("not clear"), std::string::npos);
  // Densities of either sign.
  EXPECT_FALSE(imported([&](const Vec3& p) { return 40.0 * ball(p); }));
  EXPECT_FALSE(imported([&](const Vec3& p) { return ball(p) < 0 ? 1.0 : -1.0; }));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(ImportTest, NrrdFiles) {
  const std::string voxels = PatternBytes<std::int16_t>();
  const auto check = [this](const fs::path& path) {
    const LoadedVolume volume = Imported(path);
    ExpectPattern(volume);
    ExpectSpacing(volume);
    EXPECT_EQ(volume.metadata.source, path.filename().string());
    EXPECT_EQ(volume.metadata.original_type, "int16");
    EXPECT_EQ(volume.metadata.unit, "mg");
    EXPECT_EQ(volume.metadata.value_min, 0.0);
  };
  const std::string unit = "sample units: mg\n";
  check(Write("a b.nrrd", Nrrd(voxels, "raw", "int16", unit)));
  check(Write("b.nrrd", Nrrd(Deflated(voxels, true), "gzip", "int16", unit)));
  Write("a.raw", "skipped" + voxels);
  check(Write("a.nhdr", Nrrd("", "raw", "int16", unit + "data file: a.raw\nbyte skip: 7\n")));
  check(Write("a.nhdr", Nrrd("", "raw", "int16", unit + "data file: a.raw\nbyte skip: -1\n")));
  Write("a.raw.gz", Deflated(voxels, true));
  check(Write("b.nhdr", Nrrd("", "gzip", "int16", unit + "data file: a.raw.gz\n")));
}

TEST_F(ImportTest, MetaImageOfEveryType) {
  const auto check = [this](const fs::path& path, const char* type) {
    SCOPED_TRACE(type);
    const LoadedVolume volume = Imported(path);
    ExpectPattern(volume);
    ExpectSpacing(volume);
    EXPECT_EQ(volume.metadata.original_type, type);
    EXPECT_EQ(volume.metadata.origin_W_mm, Vec3(1, 2, 3));
  };
  const auto of_type = [&](const char* type, const char* meta, std::string (*pattern)(bool)) {
    for (const bool big : {false, true}) {
      check(Write("a.mha", Meta(pattern(big), "", meta, big)), type);
    }
  };
  of_type("int8", "MET_CHAR", PatternBytes<std::int8_t>);
  of_type("uint8", "MET_UCHAR", PatternBytes<std::uint8_t>);
  of_type("int16", "MET_SHORT", PatternBytes<std::int16_t>);
  of_type("uint16", "MET_USHORT", PatternBytes<std::uint16_t>);
  of_type("int32", "MET_INT", PatternBytes<std::int32_t>);
  of_type("uint32", "MET_UINT", PatternBytes<std::uint32_t>);
  of_type("float32", "MET_FLOAT", PatternBytes<float>);
  of_type("float64", "MET_DOUBLE", PatternBytes<double>);
  const std::string shorts = PatternBytes<std::int16_t>();
  check(Write("b.mha", PackedMeta(Deflated(shorts, false))), "int16");
  check(Write("c.mha", Meta(Deflated(shorts, false), "CompressedData = True\n")), "int16");
  Write("a.raw", shorts);
  check(Write("a.mhd", Meta("", "", "MET_SHORT", false, "a.raw")), "int16");
}

TEST_F(ImportTest, NiftiFiles) {
  const std::string bytes = Nifti(PatternBytes<std::int16_t>());
  for (const fs::path& path : {Write("a.nii", bytes), Write("a.nii.gz", Deflated(bytes, true))}) {
    const LoadedVolume volume = Imported(path);
    EXPECT_EQ(At(volume, 3, 2, 1), 2 * PatternValue(3, 2, 1) - 10);
    EXPECT_EQ(volume.metadata.value_min, -10.0);
    // NIfTI is RAS, W is LPS.
    EXPECT_TRUE(volume.metadata.origin_W_mm.isApprox(Vec3(-10, -20, 30)));
    EXPECT_TRUE(volume.metadata.direction.isApprox(Mat3(Vec3(-1, -1, 1).asDiagonal())));
    ExpectSpacing(volume);
  }
}

// They reach the daemon.
TEST_F(ImportTest, ThePatientsAxesAreKnownWhereTheFileStatesThem) {
  const std::string voxels = PatternBytes<std::int16_t>();
  const auto axes = [this](const Source& source) { return Imported(source).metadata.patient_axes; };
  EXPECT_EQ(axes({.path = Write("a.nii", Nifti(voxels))}), "LPS");
  std::string unplaced = Nifti(voxels);
  unplaced[254] = 0;  // sform_code
  EXPECT_EQ(axes({.path = Write("b.nii", unplaced)}), "");
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(axes({.path = Write("a.nrrd", Nrrd(voxels))}), "");
  const std::string directions = "space directions: (1,0,0) (0,1,0) (0,0,2)\n";
  EXPECT_EQ(
      axes({.path = Write("b.nrrd", Nrrd(voxels, "raw", "int16", "space: RAS\n" + directions))}),
      "LPS");
  EXPECT_EQ(axes({.path = Write("a.mha", Meta(voxels))}), "");
  EXPECT_EQ(axes({.path = Write("b.mha", Meta(voxels, "AnatomicalOrientation = RAI\n"))}), "LPS");
  testing::WriteTiff<std::uint16_t>(Path("a.tif"), {}, PatternValue);
  EXPECT_EQ(axes({.path = Path("a.tif"), .spacing_mm = Vec3(0.5, 0.75, 2)}), "");
}

TEST_F(ImportTest, TiffStacks) {
  const auto request = [this](const std::string& name) {
    return Source{.path = Path(name), .spacing_mm = Vec3(0.5, 0.75, 2)};
  };
  testing::WriteTiff<std::uint16_t>(Path("a b.tif"), {}, PatternValue);
  const LoadedVolume volume = Imported(request("a b.tif"));
  ExpectPattern(volume);
  ExpectSpacing(volume);
  EXPECT_EQ(volume.metadata.original_type, "uint16");
  fs::create_directory(Path("s"));
  for (int z = 0; z < 4; ++z) {
    testing::WriteTiff<float>(Path("s/z" + std::to_string(z) + ".tiff"),
                              {.pages = 1, .bits = 32, .format = SAMPLEFORMAT_IEEEFP},
                              [z](int x, int y, int) { return PatternValue(x, y, z); });
  }
  ExpectPattern(Imported(request("s")));
  ExpectPattern(Imported(request("s/z0.tiff")));
  for (const char* input : {"a b.tif", "s", "s/z0.tiff"}) {
    ExpectRefused(Path(input), kInvalid, "--spacing-mm");
  }
  Write("c.tif", "text");
  ExpectRefused(request("c.tif"), kInvalid, "TIFF");
}

TEST_F(ImportTest, RawVoxels) {
  const auto request = [this](const std::string& bytes, const std::string& type) {
    // Whatever the name says.
    return Source{.path = Write("a.nrrd", bytes),
                  .spacing_mm = Vec3(0.5, 0.75, 2),
                  .raw = RawVoxels{.size = {7, 5, 4}, .type = type}};
  };
  Source raw = request("head" + PatternBytes<double>(true), "float64");
  raw.raw->big_endian = true;
  raw.raw->offset_bytes = 4;
  const LoadedVolume volume = Imported(raw);
  ExpectPattern(volume);
  ExpectSpacing(volume);
  EXPECT_EQ(volume.metadata.original_type, "float64");
  Source plain = request(PatternBytes<std::uint8_t>(), "uint8");
  plain.spacing_mm.reset();
  ExpectPattern(Imported(plain));
  EXPECT_EQ(warnings_.size(), 1u);
  plain.path = folder_.path();
  ExpectRefused(plain, kInvalid, "regular");
}

// More voxels than the importer converts at once.
TEST_F(ImportTest, WholeNumbersBecomeASmallerType) {
  const RawVoxels raw{.size = {90, 80, 100}, .type = "int32"};
  const auto value = [](int n) { return n % 251 + n / 90 % 5; };
  std::string bytes;
  for (int n = 0; n < 90 * 80 * 100; ++n) bytes += BytesOf(std::int32_t{value(n)});
  const LoadedVolume volume = Imported({.path = Write("a.raw", bytes), .raw = raw});
  EXPECT_EQ(volume.bricks.Find(0, 0, 0).type(), LeafType::kUint8);
  testing::ForEachVoxel(volume.metadata.size, [&](const Vec3i& p) {
    ASSERT_EQ(At(volume, p.x(), p.y(), p.z()), value(p.x() + 90 * (p.y() + 80 * p.z())));
  });
}

TEST_F(ImportTest, FramesOfASeries) {
  const std::string data = PatternBytes<std::int8_t>();
  std::string other;
  for (const char value : data) other += static_cast<char>(-value);
  const std::string header =
      "NRRD0005\ntype: int8\ndimension: 4\nsizes: 7 5 4 3\nspace: left-posterior-superior\n"
      "space directions: (0.5,0,0) (0,0.75,0) (0,0,2) none\nkinds: domain domain domain time\n"
      "space origin: (1,2,3)\nencoding: raw\n\n";
  const fs::path path = Write("a.nrrd", header + other + data + other);
  const LoadedVolume second = Imported({.path = path, .frame = 1, .max_voxels = 140});
  ExpectPattern(second);
  EXPECT_EQ(second.metadata.frames, 3);
  EXPECT_TRUE(warnings_.empty());
  // The first, with a word about the others.
  EXPECT_EQ(Imported(path).metadata.value_max, 0.0);
  EXPECT_EQ(warnings_.size(), 1u);
  for (const int frame : {3, -1}) {
    ExpectRefused({.path = path, .frame = frame}, kInvalid, "from 0 to 2");
  }
  // The limit is that of a frame.
  ExpectRefused({.path = path, .max_voxels = 139}, ErrorKind::kTooLarge, "139");
  // All frames must be there, whichever is read.
  Write("a.nrrd", header + other + data + other.substr(1));
  ExpectRefused({.path = path, .frame = 0}, kInvalid, "truncated");
  const fs::path single = Write("b.nrrd", Nrrd(PatternBytes<std::int16_t>()));
  ExpectRefused({.path = single, .frame = 1}, kInvalid, "");
}

TEST_F(ImportTest, LostDigitsAreAWarning) {
  const auto warnings = [&](const std::string& type, auto value) {
    std::string bytes;
    for (int n = 0; n < 7 * 5 * 4; ++n) bytes += BytesOf(static_cast<decltype(value)>(n % 9));
    bytes.replace(0, sizeof value, BytesOf(value));
    Imported(Write("a.nrrd", Nrrd(bytes, "raw", type)));
    const std::size_t of_nrrd = warnings_.size();
    const bool is_double = type == "double";
    Imported(Write("a.mha", Meta(bytes, "",
                                 is_double         ? "MET_DOUBLE"
                                 : type == "int32" ? "MET_INT"
                                                   : "MET_UINT")));
    EXPECT_EQ(warnings_.size(), of_nrrd) << type;
    return of_nrrd;
  };
  EXPECT_EQ(warnings("int32", std::int32_t{(1 << 24) + 1}), 1u);
  EXPECT_EQ(warnings("int32", std::int32_t{-(1 << 24) - 3}), 1u);
  EXPECT_EQ(warnings("uint32", std::uint32_t{4'000'000'001}), 1u);
  EXPECT_EQ(warnings("double", 0.1), 1u);
  EXPECT_EQ(warnings("int32", std::int32_t{(1 << 24) - 1}), 0u);
  EXPECT_EQ(warnings("double", 12345.0), 0u);
}

TEST_F(ImportTest, OddVoxelsGetTheLeastValueAndAWarning) {
  std::string bytes = PatternBytes<float>();
  bytes.replace(0, 4, BytesOf(std::numeric_limits<float>::quiet_NaN()));
  bytes.replace(4, 4, BytesOf(std::numeric_limits<float>::infinity()));
  bytes.replace(8, 4, BytesOf(-5.0f));
  const LoadedVolume volume = Imported(Write("a.nrrd", Nrrd(bytes, "raw", "float")));
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_EQ(volume.metadata.value_min, -5.0);
  EXPECT_EQ(At(volume, 0, 0, 0), -5.0f);
  EXPECT_EQ(At(volume, 1, 0, 0), -5.0f);
}

// ---------------------------------------------------------------- attacks

TEST_F(ImportTest, MissingEmptyAndUnknownFiles) {
  ExpectRefused(Path("none.nrrd"), ErrorKind::kNotFound, "");
  for (const char* name : {"a.nrrd", "a.nhdr", "a.mha", "a.mhd", "a.nii", "a.nii.gz", "a.vdb"}) {
    ExpectRefused(Write(name, ""), kInvalid, "");
    ExpectRefused(Write(name, "Only some text.\nOf two lines.\n"), kInvalid, "");
  }
  ExpectRefused(Write("a.txt", "x"), kInvalid, "format");
  ExpectRefused(Write("a.dcm", "x"), kInvalid, "folder");
  fs::create_directory(Path("texts"));
  ExpectRefused(Path("texts"), kInvalid, "DICOM");
  Write("texts/a.txt", "text");
  ExpectRefused(Path("texts"), kInvalid, "DICOM");
  ExpectRefused("/dev/zero", kInvalid, "regular");
  for (const auto& path : {Write("b.nhdr", Nrrd("", "raw", "uint8", "data file: none.raw\n")),
                           Write("b.mhd", Meta("", "", "MET_UCHAR", false, "none.raw"))}) {
    ExpectRefused(path, ErrorKind::kNotFound, "none.raw");
  }
}

TEST_F(ImportTest, TruncatedVoxelsAreRefused) {
  const std::string voxels = PatternBytes<std::int16_t>();
  const std::pair<const char*, std::string> files[] = {
      {"raw.nrrd", Nrrd(voxels)}, {"gzip.nrrd", Nrrd(Deflated(voxels, true), "gzip")},
      {"raw.mha", Meta(voxels)},  {"zlib.mha", PackedMeta(Deflated(voxels, false))},
      {"raw.nii", Nifti(voxels)}, {"packed.nii.gz", Deflated(Nifti(voxels), true)},
  };
  for (const auto& [name, bytes] : files) {
    for (const std::size_t cut : {1, 50}) {
      ExpectRefused(Write(name, bytes.substr(0, bytes.size() - cut)), kInvalid, "");
    }
  }
  Write("cut.raw", voxels.substr(1));
  ExpectRefused(Write("d.nhdr", Nrrd("", "raw", "int16", "data file: cut.raw\n")), kInvalid,
                "truncated");
  ExpectRefused(Write("d.mhd", Meta("", "", "MET_SHORT", false, "cut.raw")), kInvalid, "truncated");
}

TEST_F(ImportTest, DamagedAndOverlongStreamsAreRefused) {
  const std::string voxels = PatternBytes<std::int16_t>();
  std::string damaged = Deflated(voxels, true);
  damaged[damaged.size() - 6] ^= 1;  // the checksum
  ExpectRefused(Write("a.nrrd", Nrrd(damaged, "gzip")), kInvalid, "damaged");
  ExpectRefused(Write("b.nrrd", Nrrd(Deflated(voxels + voxels, true), "gzip")), kInvalid, "");
  // 100 MB of zeros in 100 kB.
  const std::string bomb = Deflated(std::string(100 << 20, '\0'), true);
  ExpectRefused(Write("c.nrrd", Nrrd(bomb, "gzip")), kInvalid, "");
  ExpectRefused(Write("c.nii.gz", bomb), kInvalid, "");
}

TEST_F(ImportTest, EveryFormatKeepsToTheLimit) {
  const std::string voxels = PatternBytes<std::int16_t>();
  for (const fs::path& path : {Write("a.nrrd", Nrrd(voxels)), Write("a.mha", Meta(voxels)),
                               Write("a.nii", Nifti(voxels))}) {
    ExpectRefused({.path = path, .max_voxels = 139}, ErrorKind::kTooLarge, "139");
    Imported({.path = path, .max_voxels = 140});
  }
}

TEST_F(ImportTest, WhatIsNoVolumeIsRefused) {
  const std::string voxels = PatternBytes<char>();
  ExpectRefused(Write("constant.nrrd", Nrrd(std::string(voxels.size(), 'x'), "raw", "uint8")),
                kInvalid, "constant");
  std::string nothing;
  for (int k = 0; k < 140; ++k) nothing += BytesOf(std::numeric_limits<float>::quiet_NaN());
  ExpectRefused(Write("nan.nrrd", Nrrd(nothing, "raw", "float")), kInvalid, "finite");
  ExpectRefused(Write("tiny.nrrd", Nrrd(voxels, "raw", "uint8", "", "1 1 1e-9")), kInvalid,
                "spacing");
  const fs::path good = Write("ok.nrrd", Nrrd(voxels, "raw", "uint8"));
  ExpectRefused({.path = good, .spacing_mm = Vec3(1, 0, 1)}, kInvalid, "spacing");
}

// ---------------------------------------------------------------- the program

class ImportProgramTest : public ImportTest {
 protected:
  static test::ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpateImport);
    return test::Process(arguments, std::chrono::seconds(120)).Wait();
  }
};

TEST_F(ImportProgramTest, WritesAVolumeThatIsReadAgain) {
  // The least value fills the border: inactive in the file.
  std::string bytes(7 * 5 * 4, '\0');
  bytes[3 + 2 * 7 + 1 * 35] = 9;
  const fs::path input = Write("a.nrrd", Nrrd(bytes, "raw", "uint8", "sample units: mg\n"));
  const auto run =
      Run({input, Path("a.vdb"), "--progress", "--frame", "0", "--spacing-mm", "3,4,5"});
  EXPECT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(run.error, "");
  EXPECT_EQ(run.output.rfind("progress 0.000 checking\n", 0), 0u) << run.output;
  EXPECT_NE(run.output.find("progress 1.000 done\n"), std::string::npos) << run.output;
  const LoadedVolume volume = Imported(Path("a.vdb"));
  EXPECT_EQ(volume.metadata.size, Vec3i(7, 5, 4));
  EXPECT_EQ(volume.metadata.spacing_mm, Vec3(3, 4, 5));
  EXPECT_EQ(volume.metadata.unit, "mg");
  EXPECT_EQ(volume.metadata.original_type, "uint8");
  EXPECT_EQ(At(volume, 3, 2, 1), 9.0f);
}

TEST_F(ImportProgramTest, ARefusalIsOneLineAndNoFile) {
  const fs::path input = Write("a.nrrd", Nrrd("too short"));
  const auto run = Run({input, Path("a.vdb")});
  EXPECT_EQ(run.exit_code, ExitCode(kInvalid));
  EXPECT_EQ(run.output, "");
  EXPECT_EQ(run.error.rfind("palpate-import: " + input.string() + ": ", 0), 0u) << run.error;
  EXPECT_EQ(run.error.find('\n'), run.error.size() - 1) << run.error;
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
  Write("a.nrrd", Nrrd(PatternBytes<std::int16_t>()));
  EXPECT_EQ(Run({input, Path("none/a.vdb")}).exit_code, ExitCode(ErrorKind::kNotFound));
}

TEST_F(ImportProgramTest, TheUserChoosesTheFormOfANiftiFile) {
  std::string bytes = Nifti(PatternBytes<std::int16_t>());
  bytes[252] = 1;  // a qform along RAS, from the origin
  const fs::path input = Write("a.nii", bytes);
  const auto origin = [&](const std::string& form) {
    const auto run = Run({input, Path("a.vdb"), "--overwrite", "--orientation", form});
    EXPECT_EQ(run.error, "");
    return Imported(Path("a.vdb")).metadata.origin_W_mm;
  };
  EXPECT_TRUE(origin("sform").isApprox(Vec3(-10, -20, 30)));
  EXPECT_TRUE(origin("qform").isZero());
  EXPECT_TRUE(origin("none").isZero());
  const fs::path other = Write("a.nrrd", Nrrd(PatternBytes<std::int16_t>()));
  EXPECT_EQ(Run({other, Path("b.vdb"), "--orientation", "none"}).exit_code, ExitCode(kInvalid));
}

TEST_F(ImportProgramTest, ReplacesAFileOnlyWhenToldTo) {
  const fs::path input = Write("a.nrrd", Nrrd(PatternBytes<std::int16_t>()));
  std::ofstream(Path("a.vdb")) << "precious";
  EXPECT_EQ(Run({input, Path("a.vdb")}).exit_code, ExitCode(ErrorKind::kConflict));
  EXPECT_EQ(fs::file_size(Path("a.vdb")), 8u);
  EXPECT_EQ(Run({input, Path("a.vdb"), "--overwrite"}).exit_code, 0);
  EXPECT_GT(fs::file_size(Path("a.vdb")), 8u);
}

TEST_F(ImportProgramTest, HelpAndUsage) {
  const auto help = Run({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_NE(help.output.find("--spacing-mm"), std::string::npos);
  EXPECT_EQ(Run({}).exit_code, kUsageExitCode);
  const std::vector<std::vector<std::string>> wrong = {
      {"--max-voxels", "-4"},
      {"--spacing-mm", "1,2"},
      {"--spacing-mm", "1,2,x"},
      {"--frame", "x"},
      {"--orientation", "x"},
      {"--raw-size", "7,5,4"},
      {"--raw-type", "float32"},
      {"--raw-big-endian"},
      {"--raw-offset", "4"},
      {"--raw-size", "7,5", "--raw-type", "float32"},
      {"--raw-size", "7,5,x", "--raw-type", "float32"},
  };
  for (std::vector<std::string> options : wrong) {
    options.insert(options.begin(), {"a", "b"});
    EXPECT_EQ(Run(options).exit_code, kUsageExitCode) << options[2];
  }
  const std::string data = Write("a.dat", PatternBytes<float>());
  for (const auto& [size, kind] :
       {std::pair("--raw-size=7,5,99999999999999999999", ErrorKind::kTooLarge),
        std::pair("--raw-size=7,-5,4", kInvalid)}) {
    EXPECT_EQ(Run({data, Path("b.vdb"), size, "--raw-type=float32"}).exit_code, ExitCode(kind));
  }
}

}  // namespace
}  // namespace palpate
