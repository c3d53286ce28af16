// palpate-import on .vdb files that it did not write.
#include <openvdb/io/File.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <random>

#include "common/error/error.h"
#include "server/volume/openvdb_grids.h"
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

// As it lies in the leaves of the grid, with the background around it.
void ExpectPatternInLeaves(const VolumeFile& file) {
  EXPECT_EQ(file.metadata.size, Vec3i(16, 16, 8));
  const openvdb::Coord first(-3, 5, 100);
  for (int z = 0; z < kPatternSize[2]; ++z) {
    for (int y = 0; y < kPatternSize[1]; ++y) {
      for (int x = 0; x < kPatternSize[0]; ++x) {
        ASSERT_EQ(file.grid->tree().getValue(first + openvdb::Coord(x, y, z)),
                  PatternValue(x, y, z));
      }
    }
  }
  EXPECT_EQ(file.grid->tree().getValue({-4, 5, 100}), file.grid->background());
}

TEST_F(ImportTest, ForeignVdb) {
  const auto transform = openvdb::math::Transform::createLinearTransform(0.5);
  transform->postTranslate({1, 2, 3});
  VolumeFile file = Imported(WriteVdb<openvdb::FloatGrid>(folder_ / "a.vdb", transform));
  ExpectPatternInLeaves(file);
  EXPECT_EQ(file.metadata.spacing_mm, Vec3(0.5, 0.5, 0.5));
  // The first voxel is that of the first leaf, (-8, 0, 96) of the grid.
  EXPECT_TRUE(file.metadata.origin_W_mm.isApprox(Vec3(-3, 2, 51)));
  ExpectPatternInLeaves(Imported(WriteVdb<openvdb::DoubleGrid>(folder_ / "a.vdb", transform)));
  ExpectPatternInLeaves(Imported(WriteVdb<openvdb::Int32Grid>(folder_ / "a.vdb", transform)));
  ExpectPatternInLeaves(Imported(WriteVdb<openvdb::Int64Grid>(folder_ / "a.vdb", transform)));
  file = Imported(WriteVdb<openvdb::BoolGrid>(folder_ / "a.vdb", transform));
  EXPECT_EQ(file.metadata.value_max, 1.0);
  EXPECT_EQ(file.metadata.original_type, "bool");
}

// The type that holds one value of two need not hold the other.
TEST_F(ImportTest, IntegersOfAnySignAndSizeComeBack) {
  openvdb::initialize();
  for (const auto& [first, second] :
       {std::pair(-5, 40000), std::pair(40000, -5), std::pair(255, -1), std::pair(-32768, 32767),
        std::pair(65535, 0), std::pair(-1, 65536)}) {
    const auto grid = openvdb::Int32Grid::create(0);
    grid->tree().setValueOn({0, 0, 0}, first);
    grid->tree().setValueOn({20, 0, 0}, second);
    openvdb::io::File out((folder_ / "i.vdb").string());
    out.write({grid});
    out.close();
    const VolumeFile file = Imported(folder_ / "i.vdb");
    EXPECT_EQ(file.grid->tree().getValue({0, 0, 0}), static_cast<float>(first));
    EXPECT_EQ(file.grid->tree().getValue({20, 0, 0}), static_cast<float>(second));
    EXPECT_EQ(file.metadata.value_min, std::min({first, second, 0}));
    EXPECT_EQ(file.metadata.value_max, std::max({first, second, 0}));
  }
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
  refused({one, one->deepCopy()}, "grids");
  const auto vectors = openvdb::Vec3SGrid::create();
  vectors->tree().setValueOn({0, 0, 0}, openvdb::Vec3f(1.0f));
  refused({vectors}, "component");
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
