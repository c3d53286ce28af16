#include "tests/integration/import_support.h"
#include "server/volume/openvdb_grids.h"
#include "tests/support/places.h"

#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "common/error/error.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::string Quote(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

std::string Contents(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

bool ReaderCrashed(const ImportRun& run) {
#ifdef PALPATE_SANITIZED
  if (run.err.find("gdcm") < run.err.find("Assertion")) return true;
  return run.err.find("AddressSanitizer") != std::string::npos &&
         run.err.find("openvdb::") < run.err.find("palpate::");
#else
  return run.exit_code == ExitCode(ErrorKind::kInternal) &&
         run.err.find("the reader crashed") != std::string::npos;
#endif
}

ImportRun RunImport(const std::vector<std::string>& arguments) {
  std::string name = (fs::temp_directory_path() / "import-run-XXXXXX").string();
  EXPECT_NE(mkdtemp(name.data()), nullptr);
  std::string command = Quote(test::kPalpateImport);
  for (const std::string& argument : arguments) command += " " + Quote(argument);
  command = "exec " + command + " >" + Quote(name + "/out") + " 2>" + Quote(name + "/err");
  const int status = std::system(command.c_str());
  ImportRun run;
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  if (run.exit_code > 128) run.exit_code = -1;
  run.out = Contents(name + "/out");
  run.err = Contents(name + "/err");
  fs::remove_all(name);
  return run;
}

void ImportTest::SetUp() {
  std::string name = (fs::temp_directory_path() / "import-test-XXXXXX").string();
  ASSERT_NE(mkdtemp(name.data()), nullptr);
  folder_ = name;
}

void ImportTest::TearDown() { fs::remove_all(folder_); }

fs::path ImportTest::Write(const std::string& name, const std::string& bytes) const {
  std::ofstream(folder_ / name, std::ios::binary) << bytes;
  return folder_ / name;
}

ImportRun ImportTest::Import(const fs::path& input, std::vector<std::string> options) const {
  options.insert(options.end(), {"--", input.string(), (folder_ / "imported.vdb").string()});
  return RunImport(options);
}

VolumeFile ImportTest::Imported(const fs::path& input,
                                const std::vector<std::string>& options) const {
  fs::remove(folder_ / "imported.vdb");
  const ImportRun run = Import(input, options);
  EXPECT_EQ(run.exit_code, 0) << input << ": " << run.err;
  if (run.exit_code != 0) return {openvdb::FloatGrid::create(), {}};
  return ReadVolumeFile(folder_ / "imported.vdb");
}

void ImportTest::ExpectRefused(const fs::path& input, int exit_code, const std::string& text,
                               const std::vector<std::string>& options) const {
  fs::remove(folder_ / "imported.vdb");
  const ImportRun run = Import(input, options);
  EXPECT_EQ(run.exit_code, exit_code) << input << ": " << run.err;
  EXPECT_NE(run.err.find(text), std::string::npos) << run.err;
  EXPECT_EQ(run.err.rfind("palpate-import: " + input.string() + ": ", 0), 0u) << run.err;
  EXPECT_EQ(run.err.find('\n'), run.err.size() - 1) << run.err;
  EXPECT_EQ(run.out, "");
  EXPECT_FALSE(fs::exists(folder_ / "imported.vdb"));
  EXPECT_FALSE(fs::exists(folder_ / "imported.vdb.partial"));
}

int PatternValue(int x, int y, int z) { return (11 * x + 23 * y + 37 * z) % 121; }

namespace {

// value(x, y, z) of the voxels, which have been read.
template <class Value>
void ExpectPatternOf(const Vec3i& size, const Value& value) {
  ASSERT_EQ(size, Vec3i(kPatternSize[0], kPatternSize[1], kPatternSize[2]));
  for (int z = 0; z < kPatternSize[2]; ++z) {
    for (int y = 0; y < kPatternSize[1]; ++y) {
      for (int x = 0; x < kPatternSize[0]; ++x) {
        ASSERT_EQ(value(x, y, z), PatternValue(x, y, z)) << x << " " << y << " " << z;
      }
    }
  }
}

}  // namespace

void ExpectPattern(const VolumeFile& file) {
  const auto accessor = file.grid->getConstAccessor();
  ExpectPatternOf(file.metadata.size, [&](int x, int y, int z) {
    return accessor.getValue({x, y, z});
  });
}

void ExpectPattern(const LoadedVolume& volume) {
  ExpectPatternOf(volume.metadata.size, [&](int x, int y, int z) {
    return volume.bricks.Find(x, y, z)[VoxelInBrick(x, y, z)];
  });
}

}  // namespace palpate
