// palpate-import on .vdb files that it did not write.
#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <random>

#include "common/error/error.h"
#include "tests/integration/import_support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr int kInvalid = ExitCode(ErrorKind::kInvalidArgument);
constexpr int kTooLargeCode = ExitCode(ErrorKind::kTooLarge);

template <typename Grid>
fs::path WriteVdb(const fs::path& path, const openvdb::math::Transform::Ptr& transform,
                  const openvdb::Coord& first = {-3, 5, 100}) {
  openvdb::initialize();
  auto grid = Grid::create();
  for (int z = 0; z < kPatternSize[2]; ++z) {
    for (int y = 0; y < kPatternSize[1]; ++y) {
      for (int x = 0; x < kPatternSize[0]; ++x) {
        using Value = typename Grid::ValueType;
        grid->tree().setValueOn(first + openvdb::Coord(x, y, z),
                                static_cast<Value>(PatternValue(x, y, z)));
      }
    }
  }
  grid->setTransform(transform);
  openvdb::io::File file(path.string());
  file.write({grid});
  file.close();
  return path;
}

TEST_F(ImportTest, ForeignVdb) {
  const auto transform = openvdb::math::Transform::createLinearTransform(0.5);
  transform->postTranslate({1, 2, 3});
  VolumeFile file = Imported(WriteVdb<openvdb::FloatGrid>(folder_ / "a.vdb", transform));
  ExpectPattern(file);
  EXPECT_EQ(file.metadata.spacing_mm, Vec3(0.5, 0.5, 0.5));
  // The first voxel is (-3, 5, 100) of the grid.
  EXPECT_TRUE(file.metadata.origin_W_mm.isApprox(Vec3(-0.5, 4.5, 53)));
  ExpectPattern(Imported(WriteVdb<openvdb::DoubleGrid>(folder_ / "a.vdb", transform)));
  ExpectPattern(Imported(WriteVdb<openvdb::Int32Grid>(folder_ / "a.vdb", transform)));
  ExpectPattern(Imported(WriteVdb<openvdb::Int64Grid>(folder_ / "a.vdb", transform)));
  file = Imported(WriteVdb<openvdb::BoolGrid>(folder_ / "a.vdb", transform));
  EXPECT_EQ(file.metadata.value_max, 1.0);
  EXPECT_EQ(file.metadata.original_type, "bool");
}

TEST_F(ImportTest, TruncatedVdbIsRefused) {
  const auto transform = openvdb::math::Transform::createLinearTransform(0.5);
  const fs::path path = WriteVdb<openvdb::FloatGrid>(folder_ / "a.vdb", transform);
  const auto size = fs::file_size(path);
  for (std::uintmax_t length = size - 1; length > 0; length -= std::min(length, size / 13)) {
    fs::copy_file(path, folder_ / "cut.vdb", fs::copy_options::overwrite_existing);
    fs::resize_file(folder_ / "cut.vdb", length);
    ExpectRefused(folder_ / "cut.vdb", kInvalid, "");
  }
}

TEST_F(ImportTest, ForeignVdbThatIsNoVolume) {
  const auto linear = openvdb::math::Transform::createLinearTransform(0.5);
  const auto refused = [&](const openvdb::GridPtrVec& grids, const std::string& text) {
    openvdb::io::File file((folder_ / "a.vdb").string());
    file.write(grids);
    file.close();
    ExpectRefused(folder_ / "a.vdb", kInvalid, text);
  };
  openvdb::initialize();
  const auto one = openvdb::FloatGrid::create();
  one->tree().setValueOn({0, 0, 0}, 1.0f);
  refused({}, "grid");
  refused({openvdb::FloatGrid::create()}, "active");
  refused({one}, "two");
  refused({one, one->deepCopy()}, "grids");
  const auto vectors = openvdb::Vec3SGrid::create();
  vectors->tree().setValueOn({0, 0, 0}, openvdb::Vec3f(1.0f));
  refused({vectors}, "scalar");
  openvdb::Mat4d shear = openvdb::Mat4d::identity();
  shear(1, 0) = 0.5;
  WriteVdb<openvdb::FloatGrid>(folder_ / "s.vdb",
                               openvdb::math::Transform::createLinearTransform(shear));
  ExpectRefused(folder_ / "s.vdb", kInvalid, "shear");
  WriteVdb<openvdb::FloatGrid>(folder_ / "f.vdb",
                               openvdb::math::Transform::createFrustumTransform(
                                   openvdb::BBoxd({0, 0, 0}, {9, 9, 9}), 0.5, 10.0, 1.0));
  ExpectRefused(folder_ / "f.vdb", kInvalid, "linear");
}

TEST_F(ImportTest, FuzzedVdb) {
  const fs::path path = WriteVdb<openvdb::FloatGrid>(
      folder_ / "a.vdb", openvdb::math::Transform::createLinearTransform(0.5));
  std::ifstream in(path, std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(in), {}};
  std::mt19937 random(5);
  for (int run = 0; run < 100; ++run) {
    std::string bytes = whole;
    for (unsigned flips = 1 + random() % 3; flips > 0; --flips) {
      bytes[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
    }
    const ImportRun result = Import(Write("f.vdb", bytes), {"--max-memory-mib", "512"});
    // OpenVDB trusts its files: a crash of the reader is caught.
    EXPECT_TRUE(result.exit_code == 0 || result.exit_code == kInvalid ||
                result.exit_code == kTooLargeCode || ReaderCrashed(result))
        << run << ": " << result.exit_code << " " << result.err;
  }
}

}  // namespace
}  // namespace palpate
