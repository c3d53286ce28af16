// Filters of whole volumes against OpenVDB's own on the grid that the volume was made of.
#include "server/volume/edit/reshape.h"
#include "server/volume/snapshot/openvdb_grids.h"

#include <gtest/gtest.h>
#include <openvdb/tools/GridTransformer.h>
#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "server/volume/snapshot/grid_tree.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

using testing::Refusal;
using Grid = openvdb::FloatGrid;
using VolumePtr = std::shared_ptr<const VolumeSnapshot>;

using testing::ForEachVoxel;
using testing::ValueAt;

const auto kQuietly = [](double) {};
const auto kGoOn = [] { return false; };
const auto kFree = [](std::uint64_t) {};

openvdb::Coord ToCoord(const Vec3i& p) { return {p.x(), p.y(), p.z()}; }

ReshapedVolume Reshaped(const VolumeSnapshot& volume, const VolumeFilter& filter) {
  return Reshape(volume, filter, kFree, kQuietly, kGoOn);
}

// In whole leaves around what is active, as a file is loaded.
VolumePtr VolumeOf(const Grid& grid) {
  const openvdb::CoordBBox active = grid.evalActiveVoxelBoundingBox();
  auto form = std::make_shared<GridForm>();
  VolumeMetadata metadata;
  for (int axis = 0; axis < 3; ++axis) {
    form->first[axis] = active.min()[axis] & -8;
    metadata.size[axis] = ((active.max()[axis] + 8) & -8) - form->first[axis];
  }
  form->background = grid.background();
  metadata.spacing_mm = Vec3::Constant(grid.voxelSize()[0]);
  metadata.origin_W_mm = metadata.spacing_mm.cwiseProduct(form->first.cast<double>());
  metadata.value_min = -grid.background();
  metadata.value_max = grid.background();
  metadata.is_level_set = grid.getGridClass() == openvdb::GRID_LEVEL_SET;
  const BrickDirectory bricks(metadata.size, [&](const Vec3i& brick) {
    const openvdb::Coord at = ToCoord(form->first + 8 * brick);
    if (const auto* const leaf = grid.tree().probeConstLeaf(at)) {
      return Leaf::Take<float>(std::make_unique<Leaf::Node<float>>(*leaf));
    }
    return Leaf::Constant(LeafType::kFloat, grid.tree().getValue(at), grid.tree().isValueOn(at));
  });
  metadata.grid_form = form;
  return std::make_shared<VolumeSnapshot>(metadata, bricks, 1, 1);
}

Grid::Ptr Sphere(float radius_mm = 6.0f, float voxel_mm = 0.5f) {
  return openvdb::tools::createLevelSetSphere<Grid>(radius_mm, openvdb::Vec3f(1.3f, -2.1f, 0.4f),
                                                    voxel_mm);
}

// Every voxel and, of a grid, its state; and nothing of the grid's is beyond the lattice.
void CheckEqual(const ReshapedVolume& made, const Grid& expected, double least, double greatest) {
  const GridForm* const form = made.metadata.grid_form.get();
  const Vec3i first = form ? form->first : Vec3i::Zero();
  ASSERT_EQ(made.bricks.brick_count(), (made.metadata.size + Vec3i::Constant(7)) / 8);
  const auto accessor = expected.getConstAccessor();
  std::uint64_t active = 0;
  ForEachVoxel(made.metadata.size, [&](const Vec3i& p) {
    const openvdb::Coord at = ToCoord(first + p);
    const float raw = accessor.getValue(at);
    const float is = std::clamp(raw, static_cast<float>(least), static_cast<float>(greatest));
    ASSERT_EQ(ValueAt(made.bricks, p), is) << p.transpose();
    if (!form) return;
    const Leaf& leaf = made.bricks.Find(p.x(), p.y(), p.z());
    ASSERT_EQ(leaf.IsActive(VoxelInBrick(p.x(), p.y(), p.z())), accessor.isValueOn(at));
    active += accessor.isValueOn(at);
  });
  if (form) {
    EXPECT_EQ(active, expected.activeVoxelCount());
  }
}

// How far along x from a place inside the surface is, mm.
double CrossingAlongX(const ReshapedVolume& made, const Vec3& from_mm) {
  const VolumeMetadata& metadata = made.metadata;
  const Vec3i start =
      ((from_mm - metadata.origin_W_mm) / metadata.spacing_mm.x()).array().round().cast<int>();
  Vec3i p = start;
  while (p.x() + 1 < metadata.size.x() && ValueAt(made.bricks, p + Vec3i(1, 0, 0)) < 0.0f) ++p.x();
  const double low = ValueAt(made.bricks, p), high = ValueAt(made.bricks, p + Vec3i(1, 0, 0));
  const Vec3 voxel = p.cast<double>() + Vec3(low / (low - high), 0, 0);
  return metadata.WorldFromIndex().Apply(voxel).x() - from_mm.x();
}

void CheckLevelSet(const VolumePtr& volume, const ReshapedVolume& made, const Grid& expected) {
  const VolumeMetadata& before = volume->metadata();
  CheckEqual(made, expected, before.value_min, before.value_max);
  // Where it lies.
  const Vec3i moved = made.metadata.grid_form->first - before.grid_form->first;
  const Vec3 origin = before.WorldFromIndex().Apply(moved.cast<double>());
  EXPECT_LT((made.metadata.origin_W_mm - origin).norm(), 1e-9);
  EXPECT_EQ(made.metadata.value_min, before.value_min);
  EXPECT_EQ(made.metadata.value_max, before.value_max);
}

TEST(Reshape, AnOffsetEqualsOpenVdbs) {
  for (const double distance_mm : {0.3, -0.3, 1.7, -4.1, 5.0}) {
    SCOPED_TRACE(distance_mm);
    const Grid::Ptr grid = Sphere();
    const VolumePtr volume = VolumeOf(*grid);
    const ReshapedVolume made =
        Reshaped(*volume, {.kind = FilterKind::kOffset, .distance_mm = distance_mm});
    openvdb::tools::LevelSetFilter<Grid>(*grid).offset(static_cast<float>(-distance_mm));
    CheckLevelSet(volume, made, *grid);
    EXPECT_TRUE(distance_mm < 1.0 || made.metadata.size != volume->size());
    EXPECT_TRUE(distance_mm > 0.0 || made.metadata.size == volume->size());
    // Outwards, by that much: along x from the middle, where the distance is 0.
    const Vec3 middle_mm(1.3, -2.1, 0.4);
    EXPECT_NEAR(CrossingAlongX(made, middle_mm), 6.0 + distance_mm, 0.05);
  }
}

TEST(Reshape, MeanCurvatureEqualsOpenVdbs) {
  const Grid::Ptr grid = Sphere();
  // An edge to smooth.
  grid->fill(openvdb::CoordBBox(openvdb::Coord(5, -8, -8), openvdb::Coord(9, 8, 8)), -0.6f);
  const VolumePtr volume = VolumeOf(*grid);
  const ReshapedVolume made =
      Reshaped(*volume, {.kind = FilterKind::kMeanCurvature, .iterations = 4});
  openvdb::tools::LevelSetFilter<Grid> filter(*grid);
  for (int n = 0; n < 4; ++n) filter.meanCurvature();
  CheckLevelSet(volume, made, *grid);
}

// Its own transform: that of the volume, with the new spacing, from the same first voxel on.
openvdb::math::Transform::Ptr Resampled(const Vec3& spacing_mm, const Vec3& first_mm) {
  openvdb::Mat4R map = openvdb::Mat4R::identity();
  for (int axis = 0; axis < 3; ++axis) {
    map[axis][axis] = spacing_mm[axis];
    map[3][axis] = first_mm[axis];
  }
  return openvdb::math::Transform::createLinearTransform(map);
}

// With several threads its last bits are not the same twice.
void ResampleByOpenVdb(const Grid& grid, Grid& out) {
  tbb::task_arena arena(1);
  arena.execute([&] { openvdb::tools::resampleToMatch<openvdb::tools::BoxSampler>(grid, out); });
}

TEST(Reshape, ResamplingEqualsOpenVdbsOnAPlainGrid) {
  std::mt19937 random(3);
  const VolumePtr made = testing::MakeVolume(Vec3i(21, 30, 17), [&](int, int, int) {
    return std::uniform_real_distribution<double>(-1000, 2000)(random);
  });
  VolumeMetadata metadata = made->metadata();
  metadata.spacing_mm = Vec3(0.5, 0.4, 2.0);
  metadata.origin_W_mm = Vec3(-7, 8, 9);
  const VolumeSnapshot volume(metadata, made->bricks(), 1, 1);
  const auto grid = Grid::create(static_cast<float>(metadata.value_min));
  grid->setTransform(Resampled(metadata.spacing_mm, Vec3::Zero()));
  ForEachVoxel(volume.size(), [&](const Vec3i& p) {
    grid->tree().setValueOn(ToCoord(p), ValueAt(volume.bricks(), p));
  });
  for (const Vec3& spacing_mm : {Vec3(0.25, 0.4, 1.0), Vec3(0.7, 0.7, 0.7), Vec3(1.9, 1.3, 4.0)}) {
    SCOPED_TRACE(spacing_mm.transpose());
    const ReshapedVolume resampled =
        Reshaped(volume, {.kind = FilterKind::kResample, .spacing_mm = spacing_mm});
    const auto out = Grid::create(grid->background());
    out->setTransform(Resampled(spacing_mm, Vec3::Zero()));
    ResampleByOpenVdb(*grid, *out);
    CheckEqual(resampled, *out, metadata.value_min, metadata.value_max);
    EXPECT_EQ(resampled.metadata.spacing_mm, spacing_mm);
    EXPECT_EQ(resampled.metadata.origin_W_mm, metadata.origin_W_mm);
    // From the first centre to the last one, and not beyond.
    const Vec3 extent =
        (resampled.metadata.size.cast<double>() - Vec3::Ones()).cwiseProduct(spacing_mm);
    const Vec3 was(10.0, 11.6, 32.0);
    EXPECT_TRUE((extent.array() <= was.array() + 1e-6).all()) << extent.transpose();
    EXPECT_TRUE((extent.array() + spacing_mm.array() > was.array()).all()) << extent.transpose();
  }
}

TEST(Reshape, AResampledLevelSetEqualsOpenVdbs) {
  for (const double spacing_mm : {0.3, 0.8}) {
    SCOPED_TRACE(spacing_mm);
    const Grid::Ptr grid = Sphere();
    const VolumePtr volume = VolumeOf(*grid);
    const ReshapedVolume made = Reshaped(
        *volume, {.kind = FilterKind::kResample, .spacing_mm = Vec3::Constant(spacing_mm)});
    // Three voxels of band.
    const auto out = Grid::create(static_cast<float>(grid->background() * spacing_mm / 0.5));
    out->setGridClass(openvdb::GRID_LEVEL_SET);
    out->setTransform(Resampled(Vec3::Constant(spacing_mm),
                                0.5 * volume->metadata().grid_form->first.cast<double>()));
    ResampleByOpenVdb(*grid, *out);
    CheckEqual(made, *out, -10.0, 10.0);
    EXPECT_TRUE(made.metadata.is_level_set);
    EXPECT_NEAR(made.metadata.value_max, 3.0 * spacing_mm, 1e-6);
    EXPECT_NEAR(made.metadata.value_min, -3.0 * spacing_mm, 1e-6);
    EXPECT_EQ(made.metadata.grid_form->background, out->background());
  }
}

TEST(Reshape, WhatIsAlikeCostsOneLeaf) {
  const VolumePtr volume = testing::MakeVolume(Vec3i(40, 40, 40), [](int i, int, int) {
    return i < 20 ? 0.0 : i < 36 ? 7.0 : 9.0;
  });
  const ReshapedVolume made =
      Reshaped(*volume, {.kind = FilterKind::kResample, .spacing_mm = Vec3::Constant(0.5)});
  ASSERT_EQ(made.metadata.size, Vec3i(79, 79, 79));
  EXPECT_EQ(made.bricks.At(Vec3i(0, 0, 0)), made.bricks.At(Vec3i(3, 9, 4)));
  EXPECT_TRUE(made.bricks.At(Vec3i(6, 6, 6))->is_constant());
  EXPECT_EQ(made.bricks.At(Vec3i(6, 6, 6))->type(), LeafType::kUint8);
}

TEST(Reshape, WhatIsNotPossibleIsRefused) {
  const VolumePtr density = testing::MakeVolume(Vec3i(9, 9, 9), [](int i, int, int) { return i; });
  const Grid::Ptr grid = Sphere(3.0f);
  const VolumePtr sphere = VolumeOf(*grid);
  const auto refusal = [](const VolumePtr& volume, const VolumeFilter& filter) {
    return Refusal([&] { Reshaped(*volume, filter); });
  };
  const auto offset = [](double mm) {
    return VolumeFilter{.kind = FilterKind::kOffset, .distance_mm = mm};
  };
  const auto resample = [](const Vec3& mm) {
    return VolumeFilter{.kind = FilterKind::kResample, .spacing_mm = mm};
  };
  EXPECT_EQ(refusal(density, offset(1.0)), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal(density, {.kind = FilterKind::kMeanCurvature}), ErrorKind::kInvalidArgument);
  // Nothing is left of a sphere of 3 mm.
  for (const double mm : {0.0, std::nan(""), 65.0, -65.0, -3.5}) {
    EXPECT_EQ(refusal(sphere, offset(mm)), ErrorKind::kInvalidArgument) << mm;
  }
  for (const int iterations : {0, -1, 1001}) {
    EXPECT_EQ(refusal(sphere, {.kind = FilterKind::kMeanCurvature, .iterations = iterations}),
              ErrorKind::kInvalidArgument);
  }
  for (const Vec3& mm : {Vec3(0, 0, 0), Vec3(1, -1, 1), Vec3(1, 1, std::nan("")), Vec3(1, 9, 1),
                         Vec3(1e-5, 1, 1), Vec3(1, 1, 1e7)}) {
    EXPECT_EQ(refusal(density, resample(mm)), ErrorKind::kInvalidArgument) << mm.transpose();
  }
  EXPECT_EQ(refusal(density, resample(Vec3::Constant(1e-4))), ErrorKind::kTooLarge);
  EXPECT_EQ(refusal(sphere, resample(Vec3(0.3, 0.3, 0.4))), ErrorKind::kInvalidArgument);
  VolumeFilter part = resample(Vec3::Constant(0.5));
  part.region = SphereShape{Vec3(4, 4, 4), 2.0};
  EXPECT_EQ(refusal(density, part), ErrorKind::kInvalidArgument);
}

TEST(Reshape, MemoryIsClaimedFirstAndCancellingEndsIt) {
  const Grid::Ptr grid = Sphere();
  const VolumePtr sphere = VolumeOf(*grid);
  const VolumePtr density =
      testing::MakeVolume(Vec3i(24, 24, 24), [](int i, int j, int k) { return (i * j + k) % 97; });
  const VolumeFilter filters[] = {
      {.kind = FilterKind::kOffset, .distance_mm = 4.0},
      {.kind = FilterKind::kMeanCurvature, .iterations = 5},
      {.kind = FilterKind::kResample, .spacing_mm = Vec3::Constant(0.4)}};
  for (const VolumeFilter& filter : filters) {
    const VolumePtr& volume = filter.kind == FilterKind::kResample ? density : sphere;
    const auto full = [](std::uint64_t) { throw Error(ErrorKind::kTooLarge, "full"); };
    EXPECT_EQ(Refusal([&] { Reshape(*volume, filter, full, kQuietly, kGoOn); }),
              ErrorKind::kTooLarge);
    EXPECT_EQ(Refusal([&] { Reshape(*volume, filter, kFree, kQuietly, [] { return true; }); }),
              ErrorKind::kCancelled);
    std::uint64_t claimed = 0;
    const ReshapedVolume made = Reshape(
        *volume, filter, [&](std::uint64_t bytes) { claimed = std::max(claimed, bytes); }, kQuietly,
        kGoOn);
    EXPECT_GE(claimed, made.bricks.MemoryBytes());
  }
}

}  // namespace
}  // namespace palpate
