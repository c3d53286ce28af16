// .vdb files that OpenVDB wrote: what is loaded is where it was, takes as little memory as in
// OpenVDB, and is saved as it was. OpenVDB alone makes and judges the files.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <random>

#include "server/volume/edit/edit.h"
#include "server/volume/save/volume_export.h"
#include "server/volume/snapshot/snapshot.h"
#include "tests/integration/import_support.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/vdb_grids.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::FloatGrid;
using testing::MakeVdbGrid;
using testing::ReadVdb;
using testing::VdbDifference;
using testing::WriteVdb;

class VdbTest : public ImportTest {
 protected:
  fs::path Written(const openvdb::GridCPtrVec& grids) const {
    WriteVdb(Path("a.vdb"), grids);
    return Path("a.vdb");
  }
  // What is in the file to which the volume is saved.
  openvdb::GridBase::Ptr Saved(const VolumeMetadata& metadata, const BrickDirectory& bricks) const {
    const VolumeSnapshot volume(metadata, bricks, 1, 1);
    ExportVolume(
        volume, {Path("saved.vdb"), true, test::kPalpateImport}, [](std::string_view, double) {},
        [] { return false; });
    return ReadVdb(Path("saved.vdb"));
  }
  openvdb::GridBase::Ptr Saved(const LoadedVolume& volume) const {
    return Saved(volume.metadata, volume.bricks);
  }
};

// The voxel of the grid that is the volume's first one. It lies where it lay in the world.
Coord FirstVoxel(const VolumeMetadata& metadata, const openvdb::GridBase& grid) {
  const AffineMap X_WI = metadata.WorldFromIndex();
  const auto index = [&](const Vec3& p_I) {
    const Vec3 p_W = X_WI.Apply(p_I);
    return grid.transform().worldToIndex(openvdb::Vec3d(p_W.x(), p_W.y(), p_W.z()));
  };
  const openvdb::Vec3d first = index(Vec3::Zero());
  const Coord rounded = Coord::round(first);
  EXPECT_LT((first - rounded.asVec3d()).length(), 1e-3);
  EXPECT_LT((index(Vec3(2, 3, 4)) - first - openvdb::Vec3d(2, 3, 4)).length(), 1e-3);
  return rounded;
}

// Random voxels of the grid's box and one of each leaf are value(voxel). Leaves are a small part
// of a sparse box.
template <class Grid, class Value>
void ExpectVoxels(const LoadedVolume& volume, const Grid& grid, Value value) {
  const Coord first = FirstVoxel(volume.metadata, grid);
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  const Vec3i& size = volume.metadata.size;
  ASSERT_TRUE(
      CoordBBox(first, first + Coord(size.x() - 1, size.y() - 1, size.z() - 1)).isInside(box));
  std::mt19937 random(2);
  const auto within = [&](const Coord& from, const Coord& count) {
    return from + Coord(static_cast<int>(random() % count.x()),
                        static_cast<int>(random() % count.y()),
                        static_cast<int>(random() % count.z()));
  };
  const auto expect = [&](const Coord& at) {
    const Coord p = at - first;
    ASSERT_EQ(At(volume, p.x(), p.y(), p.z()), static_cast<float>(value(at))) << at;
  };
  for (int n = 0; n < 3000; ++n) expect(within(box.min(), box.dim()));
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    const Coord at = within(leaf->origin(), Coord(8));
    if (box.isInside(at)) expect(at);
  }
}

TEST_F(VdbTest, EveryKindIsLoadedAndSavedAsItWas) {
  for (const char* kind : {"sphere", "cloud", "negative", "uint8", "int16", "half", "bool"}) {
    SCOPED_TRACE(kind);
    const fs::path path = Written({MakeVdbGrid(kind, 40)});
    const auto grid = ReadVdb(path);
    const LoadedVolume volume = Imported(path);
    EXPECT_EQ(warnings_.size(), 1u);  // of the unit of length
    const auto saved = Saved(volume);
    EXPECT_EQ(VdbDifference(*grid, *saved), "");
    EXPECT_EQ(volume.metadata.is_level_set, kind == std::string("sphere"));
    // What is saved is loaded and saved again.
    EXPECT_EQ(VdbDifference(*grid, *Saved(Imported(Path("saved.vdb")))), "");
    if (const auto floats = openvdb::gridPtrCast<FloatGrid>(grid)) {
      ExpectVoxels(volume, *floats, [&](const Coord& at) { return floats->tree().getValue(at); });
    }
    // The judge sees other values.
    const auto other = MakeVdbGrid(kind, kind == std::string("sphere") ? 41 : 40, 2);
    EXPECT_NE(VdbDifference(*other, *saved), "");
  }
}

// The daemon's values are floats.
TEST_F(VdbTest, WiderValuesAreRoundedWithAWarning) {
  for (const char* kind : {"double", "int32"}) {
    SCOPED_TRACE(kind);
    const auto grid = MakeVdbGrid(kind, 40);
    const LoadedVolume volume = Imported(Written({grid}));
    EXPECT_EQ(warnings_.size(), 2u);  // and one of the unit of length
    EXPECT_EQ(VdbDifference(*grid, *Saved(volume), /*rounded=*/true), "");
    EXPECT_NE(VdbDifference(*MakeVdbGrid(kind, 40, 2), *Saved(volume), /*rounded=*/true), "");
  }
}

// The type that holds one value of two need not hold the other.
TEST_F(VdbTest, IntegersOfAnySignAndSizeComeBack) {
  openvdb::initialize();
  for (const auto& [one, other] :
       {std::pair(-5, 40000), std::pair(40000, -5), std::pair(255, -1), std::pair(-32768, 32767),
        std::pair(65535, 0), std::pair(-1, 65536)}) {
    const auto grid = openvdb::Int32Grid::create(0);
    grid->tree().setValueOn({0, 0, 0}, one);
    grid->tree().setValueOn({20, 0, 0}, other);
    const LoadedVolume volume = Imported(Written({grid}));
    EXPECT_EQ(At(volume, 0, 0, 0), static_cast<float>(one));
    EXPECT_EQ(At(volume, 20, 0, 0), static_cast<float>(other));
    EXPECT_EQ(volume.metadata.value_min, std::min({one, other, 0}));
    EXPECT_EQ(volume.metadata.value_max, std::max({one, other, 0}));
  }
}

// The values say where the outside of distances is, whatever the file claims.
TEST_F(VdbTest, TheClassIsLookedAtInTheValues) {
  const auto imported = [this](bool is_inverted, openvdb::GridClass claim) {
    const auto grid = openvdb::gridPtrCast<FloatGrid>(MakeVdbGrid("sphere", 40));
    if (is_inverted) {
      for (auto value = grid->beginValueAll(); value; ++value) value.setValue(-*value);
      grid->tree().root().setBackground(-grid->background(), /*updateChildNodes=*/false);
    }
    grid->setGridClass(claim);
    return Imported(Written({grid})).metadata.is_level_set;
  };
  const auto warns = [this](const std::string& text) {
    return std::ranges::any_of(
        warnings_, [&](const auto& warning) { return warning.find(text) != std::string::npos; });
  };
  EXPECT_TRUE(imported(false, openvdb::GRID_LEVEL_SET));
  EXPECT_FALSE(warns("outside"));
  EXPECT_TRUE(imported(false, openvdb::GRID_UNKNOWN));
  EXPECT_TRUE(warns("positive outside"));
  EXPECT_FALSE(imported(true, openvdb::GRID_UNKNOWN));
  EXPECT_TRUE(warns("negative outside"));
  EXPECT_FALSE(imported(true, openvdb::GRID_LEVEL_SET));
  EXPECT_TRUE(warns("not positive outside"));
  Imported(Written({MakeVdbGrid("cloud", 40)}));
  EXPECT_FALSE(warns("distances"));
}

TEST_F(VdbTest, GridsAreChosenByName) {
  const auto cloud = MakeVdbGrid("cloud", 24), sphere = MakeVdbGrid("sphere", 24);
  const fs::path path = Written({cloud, sphere});
  for (const char* name : {"density", "surface", "--grid"}) {
    ExpectRefused(path, ErrorKind::kInvalidArgument, name);
    ExpectRefused({.path = path, .grid = "nonsense"}, ErrorKind::kInvalidArgument,
                  name[0] == '-' ? "nonsense" : name);
  }
  EXPECT_EQ(VdbDifference(*cloud, *Saved(Imported({.path = path, .grid = "density"}))), "");
  EXPECT_EQ(VdbDifference(*sphere, *Saved(Imported({.path = path, .grid = "surface"}))), "");
  ExpectRefused(Written({cloud, MakeVdbGrid("cloud", 24, 2)}), ErrorKind::kInvalidArgument,
                "density");
}

TEST_F(VdbTest, AGridOfVectorsWantsAComponent) {
  const auto grid = openvdb::gridPtrCast<openvdb::Vec3SGrid>(MakeVdbGrid("vector", 24));
  const fs::path path = Written({grid});
  ExpectRefused(path, ErrorKind::kInvalidArgument, "magnitude, x, y or z");
  ExpectRefused({.path = path, .component = "w"}, ErrorKind::kInvalidArgument,
                "magnitude, x, y or z");
  const auto load = [&](const char* component) {
    return Imported({.path = path, .component = component});
  };
  const auto& tree = grid->tree();
  ExpectVoxels(load("x"), *grid, [&](const Coord& at) { return tree.getValue(at).x(); });
  ExpectVoxels(load("y"), *grid, [&](const Coord& at) { return tree.getValue(at).y(); });
  ExpectVoxels(load("z"), *grid, [&](const Coord& at) { return tree.getValue(at).z(); });
  ExpectVoxels(load("magnitude"), *grid,
               [&](const Coord& at) { return openvdb::Vec3d(tree.getValue(at)).length(); });
}

TEST_F(VdbTest, WhatIsNoVolumeIsRefused) {
  openvdb::initialize();
  const auto refused = [&](const openvdb::GridCPtrVec& grids, const std::string& text,
                           ErrorKind kind = ErrorKind::kInvalidArgument) {
    ExpectRefused(Written(grids), kind, text);
  };
  refused({}, "grid");
  refused({FloatGrid::create()}, "active");
  refused({openvdb::GridBase::createGrid("Tree_ptdataidx32_5_4_3")}, "scalar");  // of points
  refused({MakeVdbGrid("frustum", 16)}, "linear");
  const auto one = FloatGrid::create();
  one->tree().setValueOn({0, 0, 0}, 1.0f);
  openvdb::Mat4d shear = openvdb::Mat4d::identity();
  shear(1, 0) = 0.5;
  one->setTransform(openvdb::math::Transform::createLinearTransform(shear));
  refused({one}, "shear");
  // One voxel at either end of what coordinates can be.
  const auto far = FloatGrid::create();
  far->tree().setValue(Coord(std::numeric_limits<int>::min() + 8), 1.0f);
  far->tree().setValue(Coord(std::numeric_limits<int>::max() - 8), 1.0f);
  refused({far}, "limit", ErrorKind::kTooLarge);
}

double ResidentBytes() {
  std::ifstream in("/proc/self/statm");
  double pages = 0.0;
  in >> pages >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

// Another process makes the file: what it frees here would hide a part.
TEST_F(VdbTest, TakesTheMemoryThatItTakesInOpenVdb) {
  test::Process({test::kVdbTool, "make", "cloud", "400", Path("a.vdb")}, std::chrono::seconds(300))
      .Wait();
  const double before = ResidentBytes();
  const LoadedVolume volume = Imported(Path("a.vdb"));
  const double taken = ResidentBytes() - before;
  const auto grid_bytes = static_cast<double>(ReadVdb(Path("a.vdb"))->memUsage());
  std::printf("%.3f times as much as in OpenVDB\n", taken / grid_bytes);
  EXPECT_LT(static_cast<double>(volume.bricks.MemoryBytes()), 1.3 * grid_bytes);
#ifndef PALPATE_SANITIZED
  EXPECT_LT(taken, 1.3 * grid_bytes + (8 << 20));
#endif
}

// Voxels that differ in value or state, of the leaves of both.
std::vector<Coord> DifferentVoxels(const FloatGrid& a, const FloatGrid& b) {
  std::vector<Coord> different;
  for (const FloatGrid* const grid : {&a, &b}) {
    for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
      for (auto voxel = leaf->cbeginValueAll(); voxel; ++voxel) {
        const Coord at = voxel.getCoord();
        float of_a = 0.0f, of_b = 0.0f;
        const bool on_a = a.tree().probeValue(at, of_a), on_b = b.tree().probeValue(at, of_b);
        if (of_a != of_b || on_a != on_b) different.push_back(at);
      }
    }
  }
  std::sort(different.begin(), different.end());
  different.erase(std::unique(different.begin(), different.end()), different.end());
  return different;
}

class VdbEditTest : public VdbTest {
 protected:
  // A sphere is added about a voxel of the grid: its voxels change in the file, and no others. With
  // the old bricks, the file is as it was.
  void Check(const LoadedVolume& loaded, const FloatGrid& grid, const Coord& center,
             double radius) const {
    SCOPED_TRACE(center);
    const Coord middle = center - FirstVoxel(loaded.metadata, grid);
    const VolumeSnapshot volume(loaded.metadata, loaded.bricks, 1, 1);
    const EditResult edit =
        ApplyEdit(volume, {.shape = SphereShape{Vec3(middle.x(), middle.y(), middle.z()), radius},
                           .operation = EditOperation::kAdd,
                           .value = 0.125});
    const BrickDirectory bricks = loaded.bricks.With(edit.changes, 2);
    const auto edited = openvdb::gridPtrCast<FloatGrid>(Saved(loaded.metadata, bricks));
    const std::vector<Coord> different = DifferentVoxels(grid, *edited);
    EXPECT_EQ(different.size(), edit.changed_voxels);
    EXPECT_GT(different.size(), 20u);
    for (const Coord& at : different) {
      EXPECT_LE((at - center).asVec3d().length(), radius);
      EXPECT_EQ(edited->tree().getValue(at), grid.tree().getValue(at) + 0.125f);
    }
    EXPECT_NE(VdbDifference(grid, *edited), "");
    const BrickDirectory back = bricks.With(bricks.ChangesTo(loaded.bricks), 3);
    EXPECT_EQ(VdbDifference(grid, *Saved(loaded.metadata, back)), "");
  }
};

TEST_F(VdbEditTest, ChangesItsVoxelsAndNothingElse) {
  const auto sphere = openvdb::gridPtrCast<FloatGrid>(MakeVdbGrid("sphere", 64));
  // At the surface, where no value reaches the ends of the range.
  Check(Imported(Written({sphere})), *sphere, {32, -6, 24}, 2.1);
  const auto cloud = openvdb::gridPtrCast<FloatGrid>(MakeVdbGrid("cloud", 40));
  const LoadedVolume volume = Imported(Written({cloud}));
  // In an active tile of 128 voxels.
  const CoordBBox box = cloud->evalActiveVoxelBoundingBox();
  const Coord in_tile = box.min() + Coord(40, 300, 40);
  ASSERT_EQ(cloud->tree().getValueDepth(in_tile), 1);
  Check(volume, *cloud, in_tile, 4.1);
  // Where nothing was.
  std::mt19937 random(7);
  Coord nowhere = in_tile;
  while (cloud->tree().getValueDepth(nowhere) != 2 || cloud->tree().getValue(nowhere) != 0.0f) {
    for (int axis = 0; axis < 3; ++axis) {
      nowhere[axis] = box.min()[axis] + 8 + static_cast<int>(random() % (box.dim()[axis] - 16));
    }
  }
  Check(volume, *cloud, (nowhere & ~7).offsetBy(4), 3.2);
}

TEST_F(VdbTest, TruncatedFilesAreRefused) {
  const std::string whole = test::TextOf(Written({MakeVdbGrid("cloud", 8)}));
  for (std::size_t part = 0; part < 8; ++part) {
    ExpectRefused(Write("cut.vdb", whole.substr(0, whole.size() * part / 8)),
                  ErrorKind::kInvalidArgument, "");
  }
  ExpectRefused(Write("cut.vdb", whole.substr(0, whole.size() - 1)), ErrorKind::kInvalidArgument,
                "");
}

}  // namespace
}  // namespace palpate
