// palpate-import on small files: every format and type, and attacks.
#include <zlib.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <random>

#include "common/error/error.h"
#include "server/volume/openvdb_grids.h"
#include "tests/integration/import_support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr int kInvalid = ExitCode(ErrorKind::kInvalidArgument);
constexpr int kMissing = ExitCode(ErrorKind::kNotFound);
constexpr int kTooLargeCode = ExitCode(ErrorKind::kTooLarge);

std::string Deflated(const std::string& bytes, bool gzip) {
  z_stream stream{};
  EXPECT_EQ(deflateInit2(&stream, 6, Z_DEFLATED, 15 + (gzip ? 16 : 0), 8, Z_DEFAULT_STRATEGY),
            Z_OK);
  std::string out(deflateBound(&stream, bytes.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

struct TypeCase {
  const char* name;  // ours
  const char* nrrd;
  const char* meta;
  std::int16_t nifti;
  int bytes;
  std::function<std::string(bool)> pattern;
};

const std::vector<TypeCase>& Types() {
  static const std::vector<TypeCase> kTypes = {
      {"int8", "int8", "MET_CHAR", 256, 1, PatternBytes<std::int8_t>},
      {"uint8", "uchar", "MET_UCHAR", 2, 1, PatternBytes<std::uint8_t>},
      {"int16", "short", "MET_SHORT", 4, 2, PatternBytes<std::int16_t>},
      {"uint16", "uint16_t", "MET_USHORT", 512, 2, PatternBytes<std::uint16_t>},
      {"int32", "int", "MET_INT", 8, 4, PatternBytes<std::int32_t>},
      {"uint32", "unsigned int", "MET_UINT", 768, 4, PatternBytes<std::uint32_t>},
      {"float32", "float", "MET_FLOAT", 16, 4, PatternBytes<float>},
      {"float64", "double", "MET_DOUBLE", 64, 8, PatternBytes<double>},
  };
  return kTypes;
}

std::string NrrdHeader(const std::string& type, bool big, const std::string& encoding,
                       const std::string& more = "", const std::string& sizes = "7 5 4",
                       const std::string& spacings = "0.5 0.75 2") {
  return "NRRD0004\ntype: " + type + "\ndimension: 3\nsizes: " + sizes + "\nspacings: " + spacings +
         "\nendian: " + (big ? "big" : "little") + "\nencoding: " + encoding + "\n" + more + "\n";
}

std::string MetaHeader(const std::string& type, bool big, const std::string& data,
                       const std::string& more = "", const std::string& sizes = "7 5 4") {
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = " +
         std::string(big ? "True" : "False") + "\n" + more +
         "Offset = 1 2 3\nElementSpacing = 0.5 0.75 2\nDimSize = " + sizes +
         "\nElementType = " + type + "\nElementDataFile = " + data + "\n";
}

// A header of 352 bytes; qform and sform not set.
class Nifti {
 public:
  Nifti(std::int16_t datatype, int bytes, bool big) : bytes_(352, '\0'), big_(big) {
    Put<std::int32_t>(0, 348);
    const std::int16_t dim[8] = {3, 7, 5, 4, 1, 1, 1, 1};
    for (int k = 0; k < 8; ++k) Put<std::int16_t>(40 + 2 * k, dim[k]);
    Put<std::int16_t>(70, datatype);
    Put<std::int16_t>(72, static_cast<std::int16_t>(8 * bytes));
    const float pixdim[8] = {1, 0.5f, 0.75f, 2, 1, 1, 1, 1};
    for (int k = 0; k < 8; ++k) Put<float>(76 + 4 * k, pixdim[k]);
    Put<float>(108, 352.0f);
    bytes_[123] = 2;  // mm
    std::memcpy(bytes_.data() + 344, "n+1", 4);
  }
  template <typename Number>
  Nifti& Put(std::size_t offset, Number number) {
    bytes_.replace(offset, sizeof(Number), BytesOf(number, big_));
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  bool big_;
};

void ExpectSpacing(const VolumeFile& file) {
  EXPECT_TRUE(file.metadata.spacing_mm.isApprox(Vec3(0.5, 0.75, 2), 1e-6))
      << file.metadata.spacing_mm.transpose();
}

// ---------------------------------------------------------------- what is read

TEST_F(ImportTest, NrrdOfEveryTypeAndEncoding) {
  for (const TypeCase& type : Types()) {
    for (const bool big : {false, true}) {
      for (const bool gzip : {false, true}) {
        SCOPED_TRACE(std::string(type.name) + (big ? " big" : "") + (gzip ? " gzip" : ""));
        const std::string data = type.pattern(big);
        const VolumeFile file =
            Imported(Write("a b.nrrd", NrrdHeader(type.nrrd, big, gzip ? "gzip" : "raw") +
                                           (gzip ? Deflated(data, true) : data)));
        ExpectPattern(file);
        ExpectSpacing(file);
        EXPECT_EQ(file.metadata.original_type, type.name);
        EXPECT_EQ(file.metadata.source, "a b.nrrd");
        EXPECT_EQ(file.metadata.value_min, 0.0);
      }
    }
  }
}

TEST_F(ImportTest, DetachedNrrd) {
  Write("a.raw", "skipped" + PatternBytes<std::uint16_t>());
  ExpectPattern(Imported(
      Write("a.nhdr", NrrdHeader("uint16", false, "raw", "data file: a.raw\nbyte skip: 7\n"))));
  ExpectPattern(Imported(
      Write("a.nhdr", NrrdHeader("uint16", false, "raw", "data file: a.raw\nbyte skip: -1\n"))));
  Write("a.raw.gz", Deflated(PatternBytes<std::uint16_t>(), true));
  ExpectPattern(
      Imported(Write("b.nhdr", NrrdHeader("uint16", false, "gzip", "data file: a.raw.gz\n"))));
}

TEST_F(ImportTest, NrrdSpaceIsConvertedToLps) {
  const std::string header =
      "NRRD0004\ntype: uint8\ndimension: 3\nspace: right-anterior-superior\nsizes: 7 5 4\n"
      "space directions: (0.5,0,0) (0,0.75,0) (0,0,2)\nspace origin: (10,20,30)\n"
      "encoding: raw\n\n";
  const VolumeFile file = Imported(Write("a.nrrd", header + PatternBytes<std::uint8_t>()));
  ExpectPattern(file);
  ExpectSpacing(file);
  EXPECT_TRUE(file.metadata.origin_W_mm.isApprox(Vec3(-10, -20, 30)));
  EXPECT_TRUE(file.metadata.direction.isApprox(Mat3(Vec3(-1, -1, 1).asDiagonal())));
}

TEST_F(ImportTest, MetaImageOfEveryType) {
  for (const TypeCase& type : Types()) {
    for (const bool big : {false, true}) {
      SCOPED_TRACE(std::string(type.name) + (big ? " big" : ""));
      const std::string data = type.pattern(big);
      VolumeFile file = Imported(Write("a.mha", MetaHeader(type.meta, big, "LOCAL") + data));
      ExpectPattern(file);
      ExpectSpacing(file);
      EXPECT_EQ(file.metadata.original_type, type.name);
      EXPECT_EQ(file.metadata.origin_W_mm, Vec3(1, 2, 3));
      const std::string packed = Deflated(data, false);
      ExpectPattern(
          Imported(Write("b.mha", MetaHeader(type.meta, big, "LOCAL",
                                             "CompressedData = True\nCompressedDataSize = " +
                                                 std::to_string(packed.size()) + "\n") +
                                      packed)));
    }
  }
  Write("a.raw", PatternBytes<float>());
  ExpectPattern(Imported(Write("a.mhd", MetaHeader("MET_FLOAT", false, "a.raw"))));
}

TEST_F(ImportTest, NiftiOfEveryType) {
  for (const TypeCase& type : Types()) {
    for (const bool big : {false, true}) {
      SCOPED_TRACE(std::string(type.name) + (big ? " big" : ""));
      const std::string bytes = Nifti(type.nifti, type.bytes, big).bytes() + type.pattern(big);
      VolumeFile file = Imported(Write("a.nii", bytes));
      ExpectPattern(file);
      ExpectSpacing(file);
      EXPECT_EQ(file.metadata.original_type, type.name);
      ExpectPattern(Imported(Write("a.nii.gz", Deflated(bytes, true))));
    }
  }
}

TEST_F(ImportTest, NiftiSlopeAndSformAreApplied) {
  Nifti header(4, 2, false);
  header.Put<float>(112, 2.0f).Put<float>(116, -10.0f).Put<std::int16_t>(254, 1);
  const float rows[3][4] = {{0.5f, 0, 0, 10}, {0, 0.75f, 0, 20}, {0, 0, 2, 30}};
  for (int k = 0; k < 12; ++k) header.Put<float>(280 + 4 * k, rows[k / 4][k % 4]);
  const VolumeFile file = Imported(Write("a.nii", header.bytes() + PatternBytes<std::int16_t>()));
  EXPECT_EQ(file.grid->tree().getValue({3, 2, 1}), 2 * PatternValue(3, 2, 1) - 10);
  EXPECT_EQ(file.metadata.value_min, -10.0);
  // NIfTI is RAS, W is LPS.
  EXPECT_TRUE(file.metadata.origin_W_mm.isApprox(Vec3(-10, -20, 30)));
  EXPECT_TRUE(file.metadata.direction.isApprox(Mat3(Vec3(-1, -1, 1).asDiagonal())));
  ExpectSpacing(file);
}

TEST_F(ImportTest, OurOwnVdbKeepsItsSize) {
  // The least value fills the border: inactive in the file.
  std::string bytes(7 * 5 * 4, '\0');
  bytes[3 + 2 * 7 + 1 * 35] = 9;
  const VolumeFile first =
      Imported(Write("a.nrrd", NrrdHeader("uint8", false, "raw", "sample units: mg\n") + bytes));
  fs::copy_file(folder_ / "imported.vdb", folder_ / "again.vdb");
  const VolumeFile second = Imported(folder_ / "again.vdb");
  EXPECT_EQ(second.metadata.size, first.metadata.size);
  EXPECT_EQ(second.metadata.spacing_mm, first.metadata.spacing_mm);
  EXPECT_EQ(second.metadata.unit, "mg");
  EXPECT_EQ(second.metadata.original_type, "uint8");
}

TEST_F(ImportTest, SpacingOptionAndProgress) {
  const fs::path input = Write("a.nrrd", NrrdHeader("uint8", false, "raw") + PatternBytes<char>());
  const VolumeFile file = Imported(input, {"--spacing-mm", "3,4,5"});
  EXPECT_EQ(file.metadata.spacing_mm, Vec3(3, 4, 5));
  const ImportRun run = Import(input, {"--progress"});
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_EQ(run.out.rfind("progress 0.000 checking\n", 0), 0u) << run.out;
  EXPECT_NE(run.out.find("progress 1.000 done\n"), std::string::npos) << run.out;
}

TEST_F(ImportTest, OddVoxelsGetTheLeastValueAndAWarning) {
  std::string bytes = PatternBytes<float>();
  bytes.replace(0, 4, BytesOf(std::numeric_limits<float>::quiet_NaN()));
  bytes.replace(4, 4, BytesOf(std::numeric_limits<float>::infinity()));
  bytes.replace(8, 4, BytesOf(-5.0f));
  const fs::path input = Write("a.nrrd", NrrdHeader("float", false, "raw") + bytes);
  const ImportRun run = Import(input);
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_EQ(run.err.rfind("palpate-import: warning: ", 0), 0u) << run.err;
  const VolumeFile file = ReadVolumeFile(folder_ / "imported.vdb");
  EXPECT_EQ(file.metadata.value_min, -5.0);
  EXPECT_EQ(file.grid->tree().getValue({0, 0, 0}), -5.0f);
  EXPECT_EQ(file.grid->tree().getValue({1, 0, 0}), -5.0f);
}

TEST_F(ImportTest, HelpAndUsage) {
  const ImportRun help = RunImport({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_NE(help.out.find("--spacing-mm"), std::string::npos);
  EXPECT_EQ(RunImport({}).exit_code, kUsageExitCode);
  EXPECT_EQ(RunImport({"a", "b", "--max-voxels", "-4"}).exit_code, kUsageExitCode);
  EXPECT_EQ(RunImport({"a", "b", "--spacing-mm", "1,2"}).exit_code, kUsageExitCode);
  EXPECT_EQ(RunImport({"a", "b", "--spacing-mm", "1,2,x"}).exit_code, kUsageExitCode);
}

// ---------------------------------------------------------------- attacks

TEST_F(ImportTest, MissingEmptyAndUnknownFiles) {
  ExpectRefused(folder_ / "none.nrrd", kMissing, "no such file");
  for (const char* name : {"a.nrrd", "a.nhdr", "a.mha", "a.mhd", "a.nii", "a.nii.gz", "a.vdb"}) {
    ExpectRefused(Write(name, ""), kInvalid, "");
    ExpectRefused(Write(name, "Only some text.\nOf two lines.\n"), kInvalid, "");
    ExpectRefused(Write(name, std::string(5000, '\0')), kInvalid, "");
  }
  ExpectRefused(Write("a.txt", "x"), kInvalid, "format");
  ExpectRefused(Write("a.dcm", "x"), kInvalid, "folder");
  fs::create_directory(folder_ / "empty folder");
  ExpectRefused(folder_ / "empty folder", kInvalid, "no DICOM");
  fs::create_directory(folder_ / "texts");
  Write("texts/a.txt", "text");
  ExpectRefused(folder_ / "texts", kInvalid, "no DICOM");
  ExpectRefused("/dev/zero", kInvalid, "regular");
}

TEST_F(ImportTest, EveryTruncationIsRefused) {
  const std::string voxels = PatternBytes<std::int16_t>();
  const std::string packed = Deflated(voxels, false);
  const std::map<std::string, std::string> files = {
      {"raw.nrrd", NrrdHeader("int16", false, "raw") + voxels},
      {"gzip.nrrd", NrrdHeader("int16", false, "gzip") + Deflated(voxels, true)},
      {"raw.mha", MetaHeader("MET_SHORT", false, "LOCAL") + voxels},
      {"zlib.mha", MetaHeader("MET_SHORT", false, "LOCAL",
                              "CompressedData = True\nCompressedDataSize = " +
                                  std::to_string(packed.size()) + "\n") +
                       packed},
      {"raw.nii", Nifti(4, 2, false).bytes() + voxels},
      {"packed.nii.gz", Deflated(Nifti(4, 2, false).bytes() + voxels, true)},
  };
  for (const auto& [name, bytes] : files) {
    SCOPED_TRACE(name);
    ExpectPattern(Imported(Write(name, bytes)));
    for (const std::size_t cut : {1ul, 2ul, 9ul, 50ul, bytes.size() / 2, bytes.size() - 3}) {
      ExpectRefused(Write(name, bytes.substr(0, bytes.size() - cut)), kInvalid, "");
    }
  }
  Write("cut.raw", voxels.substr(1));
  ExpectRefused(Write("d.nhdr", NrrdHeader("int16", false, "raw", "data file: cut.raw\n")),
                kInvalid, "truncated");
  ExpectRefused(Write("d.mhd", MetaHeader("MET_SHORT", false, "cut.raw")), kInvalid, "truncated");
}

TEST_F(ImportTest, DamagedAndOverlongStreamsAreRefused) {
  const std::string voxels = PatternBytes<std::int16_t>();
  std::string damaged = Deflated(voxels, true);
  damaged[damaged.size() - 6] ^= 1;  // the checksum
  ExpectRefused(Write("a.nrrd", NrrdHeader("int16", false, "gzip") + damaged), kInvalid, "damaged");
  ExpectRefused(
      Write("b.nrrd", NrrdHeader("int16", false, "gzip") + Deflated(voxels + voxels, true)),
      kInvalid, "does not fit");
  // MetaIO would deliver zeros.
  ExpectRefused(Write("b.mha", MetaHeader("MET_SHORT", false, "LOCAL", "CompressedData = True\n") +
                                   Deflated(voxels, false)),
                kInvalid, "CompressedDataSize");
  // 100 MB of zeros in 100 kB.
  const std::string bomb = Deflated(std::string(100 << 20, '\0'), true);
  ExpectRefused(Write("c.nrrd", NrrdHeader("int16", false, "gzip") + bomb), kInvalid, "");
  ExpectRefused(Write("c.nii.gz", bomb), kInvalid, "");
}

TEST_F(ImportTest, AbsurdSizesAreRefusedBeforeAnythingIsAllocated) {
  for (const char* sizes : {"100000 100000 100000", "4294967296 4294967296 4294967296",
                            "2000000000 2000000000 2000000000", "3037000500 3037000500 2"}) {
    ExpectRefused(Write("a.nrrd", NrrdHeader("uint8", false, "raw", "", sizes)), kTooLargeCode,
                  "limit");
    ExpectRefused(Write("a.mha", MetaHeader("MET_UCHAR", false, "LOCAL", "", sizes)), kTooLargeCode,
                  "limit");
  }
  Nifti nifti(2, 1, false);
  for (int k = 1; k <= 3; ++k) nifti.Put<std::int16_t>(40 + 2 * k, 32767);
  ExpectRefused(Write("a.nii", nifti.bytes()), kTooLargeCode, "limit");
  // One active voxel at either end of what coordinates can be.
  openvdb::initialize();
  const auto grid = openvdb::FloatGrid::create();
  grid->tree().setValue(openvdb::Coord(std::numeric_limits<int>::min() + 8), 1.0f);
  grid->tree().setValue(openvdb::Coord(std::numeric_limits<int>::max() - 8), 1.0f);
  openvdb::io::File file((folder_ / "a.vdb").string());
  file.write({grid});
  file.close();
  ExpectRefused(folder_ / "a.vdb", kTooLargeCode, "limit");

  const std::string small = NrrdHeader("uint8", false, "raw") + PatternBytes<char>();
  ExpectRefused(Write("b.nrrd", small), kTooLargeCode, "limit", {"--max-voxels", "139"});
  Imported(folder_ / "b.nrrd", {"--max-voxels", "140"});
}

TEST_F(ImportTest, DataFilesOutsideAreRefused) {
  fs::create_directory(folder_ / "in");
  Write("a.raw", PatternBytes<char>());
  for (const std::string& name :
       {std::string("../a.raw"), (folder_ / "a.raw").string(), std::string("x/../../a.raw")}) {
    ExpectRefused(
        Write("in/a.nhdr", NrrdHeader("uint8", false, "raw", "data file: " + name + "\n")),
        kInvalid, "outside");
    ExpectRefused(Write("in/a.mhd", MetaHeader("MET_UCHAR", false, name)), kInvalid, "outside");
  }
  ExpectRefused(Write("in/b.nhdr", NrrdHeader("uint8", false, "raw", "data file: none.raw\n")),
                kMissing, "none.raw");
  ExpectRefused(Write("in/b.mhd", MetaHeader("MET_UCHAR", false, "none.raw")), kMissing,
                "none.raw");
}

TEST_F(ImportTest, WhatIsNoVolumeIsRefused) {
  const std::string voxels = PatternBytes<char>();
  ExpectRefused(Write("flat.nrrd", NrrdHeader("uint8", false, "raw", "", "35 4 1") + voxels),
                kInvalid, "two");
  ExpectRefused(
      Write("constant.nrrd", NrrdHeader("uint8", false, "raw") + std::string(voxels.size(), 'x')),
      kInvalid, "constant");
  std::string nothing;
  for (int k = 0; k < 140; ++k) nothing += BytesOf(std::numeric_limits<float>::quiet_NaN());
  ExpectRefused(Write("nan.nrrd", NrrdHeader("float", false, "raw") + nothing), kInvalid, "finite");
  Nifti five(2, 1, false);
  five.Put<std::int16_t>(40, 5).Put<std::int16_t>(48, 2).Put<std::int16_t>(50, 2);
  ExpectRefused(Write("5d.nii", five.bytes() + voxels + voxels), kInvalid, "three axes");
  Nifti rgb(128, 3, false);
  ExpectRefused(Write("rgb.nii", rgb.bytes() + voxels + voxels + voxels), kInvalid, "several");
  ExpectRefused(
      Write("vector.mha", MetaHeader("MET_UCHAR", false, "LOCAL", "ElementNumberOfChannels = 3\n") +
                              voxels + voxels + voxels),
      kInvalid, "several");
  Nifti zero(2, 1, false);
  zero.Put<float>(80, 0.0f);
  ExpectRefused(Write("zero.nii", zero.bytes() + voxels), kInvalid, "spacing");
  ExpectRefused(
      Write("tiny.nrrd", NrrdHeader("uint8", false, "raw", "", "7 5 4", "1 1 1e-9") + voxels),
      kInvalid, "spacing");
  ExpectRefused(Write("ok.nrrd", NrrdHeader("uint8", false, "raw") + voxels), kInvalid, "spacing",
                {"--spacing-mm", "1,0,1"});
}

TEST_F(ImportTest, FailingWriteIsReported) {
  const fs::path input = Write("a.nrrd", NrrdHeader("uint8", false, "raw") + PatternBytes<char>());
  const ImportRun run = RunImport({input.string(), (folder_ / "none" / "a.vdb").string()});
  EXPECT_EQ(run.exit_code, ExitCode(ErrorKind::kNotFound));
  EXPECT_EQ(run.err.find('\n'), run.err.size() - 1) << run.err;
}

// Flipped and cut headers end in success or in a refusal with one line, never in
// a signal or an internal error.
TEST_F(ImportTest, FuzzedHeaders) {
  const std::string voxels = PatternBytes<std::int16_t>();
  const std::pair<std::string, std::string> files[] = {
      {"f.nrrd", NrrdHeader("int16", false, "raw") + voxels},
      {"f.nrrd", NrrdHeader("int16", false, "raw",
                            "space: left-posterior-superior\nkinds: domain domain domain\n"
                            "axis mins: 0 0 0\nthicknesses: 1 1 1\n") +
                     voxels},
      {"f.mha",
       MetaHeader("MET_SHORT", false, "LOCAL", "TransformMatrix = 1 0 0 0 1 0 0 0 1\n") + voxels},
      {"f.nii", Nifti(4, 2, false).bytes() + voxels},
      {"f.nii.gz", Deflated(Nifti(4, 2, false).bytes() + voxels, true)},
  };
  std::mt19937 random(7);
  for (int run = 0; run < 200; ++run) {
    auto [name, bytes] = files[run % std::size(files)];
    for (unsigned flips = 1 + random() % 3; flips > 0; --flips) {
      bytes[random() % std::min<std::size_t>(bytes.size(), 400)] ^=
          static_cast<char>(1 << random() % 8);
    }
    if (random() % 8 == 0) bytes.resize(random() % bytes.size());
    const ImportRun result = Import(Write(name, bytes));
    const int code = result.exit_code;
    EXPECT_TRUE(code == 0 || code == kInvalid || code == kMissing || code == kTooLargeCode)
        << name << " run " << run << ": " << code << " " << result.err;
    EXPECT_TRUE(code == 0 || result.err.find('\n') == result.err.size() - 1) << result.err;
  }
}

}  // namespace
}  // namespace palpate
