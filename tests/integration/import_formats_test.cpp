// palpate-import on frames of series, TIFF stacks and raw voxels.
#include <fstream>

#include "common/error/error.h"
#include "tests/integration/import_support.h"
#include "tests/support/tiff_writer.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using testing::TiffLayout;
using testing::WriteTiff;

constexpr int kInvalid = ExitCode(ErrorKind::kInvalidArgument);
constexpr int kTooLargeCode = ExitCode(ErrorKind::kTooLarge);

const std::vector<std::string> kSpacing = {"--spacing-mm", "0.5,0.75,2"};

// ---------------------------------------------------------------- frames

// A second frame that differs from the pattern by its sign.
std::string Negated() {
  std::string bytes;
  for (const char value : PatternBytes<std::int8_t>()) bytes += static_cast<char>(-value);
  return bytes;
}

std::string NrrdSeries(const std::string& sizes = "7 5 4 3") {
  return "NRRD0005\ntype: int8\ndimension: 4\nsizes: " + sizes +
         "\nspace: left-posterior-superior\n"
         "space directions: (0.5,0,0) (0,0.75,0) (0,0,2) none\nkinds: domain domain domain time\n"
         "space origin: (1,2,3)\nencoding: raw\n\n";
}

TEST_F(ImportTest, FramesOfNrrd) {
  const std::string other = Negated();
  const fs::path input =
      Write("a.nrrd", NrrdSeries() + other + PatternBytes<std::int8_t>() + other);
  const VolumeFile file = Imported(input, {"--frame", "1"});
  ExpectPattern(file);
  EXPECT_EQ(file.metadata.frames, 3);
  EXPECT_TRUE(file.metadata.spacing_mm.isApprox(Vec3(0.5, 0.75, 2)));
  EXPECT_EQ(file.metadata.origin_W_mm, Vec3(1, 2, 3));
  // The first, with a word about the others.
  const ImportRun run = Import(input);
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_NE(run.err.find("there are 3 frames"), std::string::npos) << run.err;
  EXPECT_EQ(ReadVolumeFile(folder_ / "imported.vdb").metadata.value_max, 0.0);
  EXPECT_EQ(Import(input, {"--frame", "0"}).err, "");
  // Through our own format again.
  fs::copy_file(folder_ / "imported.vdb", folder_ / "again.vdb");
  EXPECT_EQ(Imported(folder_ / "again.vdb").metadata.frames, 3);
}

TEST_F(ImportTest, FramesThatAreNotThere) {
  const std::string data = PatternBytes<std::int8_t>();
  const fs::path series = Write("a.nrrd", NrrdSeries() + data + data + data);
  ExpectRefused(series, kInvalid, "from 0 to 2", {"--frame", "3"});
  ExpectRefused(series, kInvalid, "from 0 to 2", {"--frame=-1"});
  const fs::path raw = Write("a.raw", data);
  ExpectRefused(raw, kInvalid, "one volume",
                {"--raw-size", "7,5,4", "--raw-type", "int8", "--frame", "1"});
  // All frames must be there, whichever is read.
  const fs::path cut = Write("b.nrrd", (NrrdSeries() + data + data + data).substr(0, 500));
  ExpectRefused(cut, kInvalid, "truncated", {"--frame", "0"});
}

// Limits are those of the frame; sizes that overflow are refused.
TEST_F(ImportTest, LimitsHoldForOneFrame) {
  const std::string data = PatternBytes<std::int8_t>();
  const fs::path series = Write("a.nrrd", NrrdSeries() + data + data + data);
  Imported(series, {"--max-voxels", "140", "--frame", "0"});
  ExpectRefused(series, kTooLargeCode, "limit", {"--max-voxels", "139"});
  ExpectRefused(Write("b.nrrd", NrrdSeries("1000 1000 1000 2147483647")), kInvalid, "");
  ExpectRefused(Write("b.nrrd", NrrdSeries("1000 1000 1000 9223372036854775807")), kInvalid, "");
}

// ---------------------------------------------------------------- TIFF

TEST_F(ImportTest, TiffStack) {
  const auto pattern = [](int x, int y, int z) { return PatternValue(x, y, z); };
  WriteTiff<std::uint16_t>(folder_ / "a b.tif", {}, pattern);
  const VolumeFile file = Imported(folder_ / "a b.tif", kSpacing);
  ExpectPattern(file);
  EXPECT_EQ(file.metadata.spacing_mm, Vec3(0.5, 0.75, 2));
  EXPECT_EQ(file.metadata.original_type, "uint16");
  EXPECT_EQ(file.metadata.source, "a b.tif");
  fs::create_directory(folder_ / "s");
  for (int z = 0; z < 4; ++z) {
    WriteTiff<float>(folder_ / "s" / ("z" + std::to_string(z) + ".tiff"),
                     {.pages = 1, .bits = 32, .format = SAMPLEFORMAT_IEEEFP},
                     [z](int x, int y, int) { return PatternValue(x, y, z); });
  }
  ExpectPattern(Imported(folder_ / "s", kSpacing));
  ExpectPattern(Imported(folder_ / "s" / "z0.tiff", kSpacing));
  for (const char* input : {"a b.tif", "s", "s/z0.tiff"}) {
    ExpectRefused(folder_ / input, kInvalid, "give the spacing: --spacing-mm X,Y,Z");
  }
  fs::remove(folder_ / "s" / "z2.tiff");
  ExpectRefused(folder_ / "s", kInvalid, "missing", kSpacing);
  ExpectRefused(Write("c.tif", "text"), kInvalid, "no TIFF", kSpacing);
  ExpectRefused(Write("d.tif", ""), kInvalid, "no TIFF", kSpacing);
}

// ---------------------------------------------------------------- raw

TEST_F(ImportTest, RawVoxels) {
  const std::vector<std::string> size = {"--raw-size", "7,5,4", "--spacing-mm", "0.5,0.75,2"};
  const auto with = [&size](std::vector<std::string> more) {
    more.insert(more.end(), size.begin(), size.end());
    return more;
  };
  const VolumeFile file =
      Imported(Write("a.dat", PatternBytes<float>()), with({"--raw-type", "float32"}));
  ExpectPattern(file);
  EXPECT_EQ(file.metadata.spacing_mm, Vec3(0.5, 0.75, 2));
  EXPECT_EQ(file.metadata.original_type, "float32");
  ExpectPattern(Imported(Write("b.dat", "head" + PatternBytes<double>(true)),
                         with({"--raw-type", "float64", "--raw-big-endian", "--raw-offset", "4"})));
  // Whatever the name says.
  ExpectPattern(
      Imported(Write("c.nrrd", PatternBytes<std::uint8_t>()), with({"--raw-type", "uint8"})));
  ExpectRefused(folder_ / "a.dat", kInvalid, "560 bytes", with({"--raw-type", "int16"}));
  ExpectRefused(folder_ / "a.dat", kInvalid, "280 bytes", with({"--raw-type", "int16"}));
  ExpectRefused(folder_ / "a.dat", kInvalid, "no voxel type 'half'", with({"--raw-type", "half"}));
  ExpectRefused(folder_, kInvalid, "regular", with({"--raw-type", "uint8"}));
  ExpectRefused(folder_ / "a.dat", kInvalid, "--raw-size");
  const ImportRun plain =
      Import(folder_ / "c.nrrd", {"--raw-size", "7,5,4", "--raw-type", "uint8"});
  EXPECT_NE(plain.err.find("warning"), std::string::npos) << plain.err;
}

TEST_F(ImportTest, RawOptionsBelongTogether) {
  Write("a.dat", PatternBytes<float>());
  const std::vector<std::vector<std::string>> wrong = {
      {"--raw-size", "7,5,4"},
      {"--raw-type", "float32"},
      {"--raw-big-endian"},
      {"--raw-offset", "4"},
      {"--raw-size", "7,5", "--raw-type", "float32"},
      {"--raw-size", "7,5,4,1", "--raw-type", "float32"},
      {"--raw-size", "7,5,x", "--raw-type", "float32"},
      {"--frame", "x"},
  };
  for (const auto& options : wrong) {
    EXPECT_EQ(Import(folder_ / "a.dat", options).exit_code, kUsageExitCode) << options[0];
  }
  ExpectRefused(
      folder_ / "a.dat", kTooLargeCode, "limit",
      {"--raw-size", "7,5,99999999999999999999", "--raw-type", "uint8", "--spacing-mm", "1,1,1"});
  ExpectRefused(folder_ / "a.dat", kInvalid, "-5",
                {"--raw-size=7,-5,4", "--raw-type", "float32", "--spacing-mm", "1,1,1"});
}

}  // namespace
}  // namespace palpate
