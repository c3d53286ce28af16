#include "server/volume/volume_file.h"
#include "server/volume/openvdb_grids.h"

#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>

#include <gtest/gtest.h>
#include <openvdb/io/File.h>
#include <openvdb/tools/Dense.h>

#include "common/error/error.h"
#include "server/volume/snapshot_builder.h"
#include "tests/support/volume_file.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

class VolumeFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "volume-file-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path folder_;
};

float Value(int x, int y, int z) { return static_cast<float>((3 * x + 5 * y + 7 * z) % 101); }

VolumeMetadata MakeMetadata() {
  VolumeMetadata metadata;
  metadata.size = {20, 11, 9};
  metadata.spacing_mm = {0.5, 0.75, 1.25};
  metadata.origin_W_mm = {-10.0, 20.0, 30.5};
  metadata.direction << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  metadata.value_min = 0.0;
  metadata.value_max = 100.0;
  metadata.frames = 20;
  metadata.unit = "HU";
  metadata.original_type = "int16";
  metadata.source = "head scan.nrrd";
  return metadata;
}

BrickDirectory MakeBricks(const Vec3i& size) {
  auto grid = openvdb::FloatGrid::create(0.0f);
  openvdb::tools::Dense<float, openvdb::tools::LayoutXYZ> dense(
      openvdb::CoordBBox({0, 0, 0}, {size.x() - 1, size.y() - 1, size.z() - 1}));
  for (int z = 0; z < size.z(); ++z) {
    for (int y = 0; y < size.y(); ++y) {
      for (int x = 0; x < size.x(); ++x) {
        dense.setValue(openvdb::Coord(x, y, z), Value(x, y, z));
      }
    }
  }
  openvdb::tools::copyFromDense(dense, *grid, 0.0f);
  return TakeBricks(*grid, size);
}

TEST_F(VolumeFileTest, ReturnsWhatWasWritten) {
  const VolumeMetadata written = MakeMetadata();
  WriteVolumeFile(folder_ / "a.vdb", MakeBricks(written.size), written);
  const VolumeFile file = ReadVolumeFile(folder_ / "a.vdb");
  EXPECT_EQ(file.metadata.size, written.size);
  EXPECT_EQ(file.metadata.spacing_mm, written.spacing_mm);
  EXPECT_EQ(file.metadata.origin_W_mm, written.origin_W_mm);
  EXPECT_EQ(file.metadata.direction, written.direction);
  EXPECT_EQ(file.metadata.value_min, written.value_min);
  EXPECT_EQ(file.metadata.value_max, written.value_max);
  EXPECT_EQ(file.metadata.frames, written.frames);
  EXPECT_EQ(file.metadata.unit, written.unit);
  EXPECT_EQ(file.metadata.original_type, written.original_type);
  EXPECT_EQ(file.metadata.source, written.source);
  EXPECT_EQ(file.grid->getName(), "density");
  EXPECT_EQ(file.grid->background(), 0.0f);
  auto accessor = file.grid->getConstAccessor();
  for (int z = 0; z < written.size.z(); ++z) {
    for (int y = 0; y < written.size.y(); ++y) {
      for (int x = 0; x < written.size.x(); ++x) {
        ASSERT_EQ(accessor.getValue({x, y, z}), Value(x, y, z)) << x << ' ' << y << ' ' << z;
      }
    }
  }
}

TEST_F(VolumeFileTest, TransformMapsVoxelsToWorld) {
  const VolumeMetadata metadata = MakeMetadata();
  WriteVolumeFile(folder_ / "a.vdb", MakeBricks(metadata.size), metadata);
  const VolumeFile file = ReadVolumeFile(folder_ / "a.vdb");
  for (const Vec3& p_I : {Vec3(0, 0, 0), Vec3(3, 4, 5), Vec3(19, 10, 8)}) {
    const Vec3 expected = metadata.WorldFromIndex().Apply(p_I);
    const openvdb::Vec3d p_W = file.grid->indexToWorld(openvdb::Vec3d(p_I.x(), p_I.y(), p_I.z()));
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(p_W[k], expected[k], 1e-12);
  }
}

TEST_F(VolumeFileTest, ObliqueAndTinySpacingsSurvive) {
  VolumeMetadata metadata = MakeMetadata();
  metadata.direction = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  metadata.spacing_mm = {kLeastSpacingMm, kLeastSpacingMm, 2 * kLeastSpacingMm};
  WriteVolumeFile(folder_ / "a.vdb", MakeBricks(metadata.size), metadata);
  EXPECT_EQ(ReadVolumeFile(folder_ / "a.vdb").metadata.direction, metadata.direction);
}

TEST_F(VolumeFileTest, LeavesNoPartialFileAndReplacesTheOldOne) {
  VolumeMetadata metadata = MakeMetadata();
  const BrickDirectory bricks = MakeBricks(metadata.size);
  WriteVolumeFile(folder_ / "a.vdb", bricks, metadata);
  metadata.unit = "changed";
  WriteVolumeFile(folder_ / "a.vdb", bricks, metadata);
  EXPECT_EQ(ReadVolumeFile(folder_ / "a.vdb").metadata.unit, "changed");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(VolumeFileTest, RefusesToWriteWhatIsNoVolume) {
  const BrickDirectory bricks = MakeBricks({20, 11, 9});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::function<void(VolumeMetadata*)>> attacks = {
      [](VolumeMetadata* m) { m->size.x() = 1; },
      [](VolumeMetadata* m) { m->size.y() = -5; },
      [](VolumeMetadata* m) { m->spacing_mm.x() = 0.0; },
      [nan](VolumeMetadata* m) { m->spacing_mm.z() = nan; },
      [nan](VolumeMetadata* m) { m->origin_W_mm.z() = nan; },
      [nan](VolumeMetadata* m) { m->direction(1, 1) = nan; },
      [](VolumeMetadata* m) { m->direction(0, 1) = 0.3; },  // sheared
      [](VolumeMetadata* m) { m->direction.setZero(); },
      [](VolumeMetadata* m) { m->value_max = m->value_min; },
      [](VolumeMetadata* m) { m->source.assign(5000, 'x'); },
  };
  for (std::size_t k = 0; k < attacks.size(); ++k) {
    VolumeMetadata metadata = MakeMetadata();
    attacks[k](&metadata);
    EXPECT_THROW(WriteVolumeFile(folder_ / "a.vdb", bricks, metadata), Error) << k;
    EXPECT_TRUE(fs::is_empty(folder_)) << k;
  }
}

TEST_F(VolumeFileTest, UnwritableFolderIsReported) {
  const VolumeMetadata metadata = MakeMetadata();
  try {
    WriteVolumeFile(folder_ / "none" / "a.vdb", MakeBricks(metadata.size), metadata);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kNotFound);
  }
}

}  // namespace
}  // namespace palpate
