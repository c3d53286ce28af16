// The surface that is drawn is the exact one: whole, cut, veiled, of real volumes.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "client/view/scene/color_map.h"
#include "tests/support/data_folder.h"
#include "tests/support/surface_rig.h"

namespace palpate::view {
namespace {

using testing::CastRig;
using testing::CpuCaster;
using testing::kOddSize;
using testing::kSize;
using testing::kSmallSize;
using testing::Look;
using testing::LooksAt;
using testing::MakeVoxels;
using testing::Mirrored;
using testing::Picture;
using testing::Scene;
using testing::Slab;

class Surface : public testing::SurfaceRig {};

TEST_F(Surface, IsExactWhateverItIsAndHoweverItIsPlaced) {
  struct Case {
    const char* name;
    testing::VoxelArray voxels;
    double isovalue;
    AffineMap placed;
  };
  const Case cases[] = {{"sphere", testing::Sphere(26, 9.0), 0.0, Mirrored()},
                        {"gyroid", testing::Gyroid({30, 25, 34}), 0.2, testing::Sheared()},
                        {"noise", testing::Noise({16, 16, 16}), 0.5, Mirrored()},
                        {"thin noise", testing::Noise({16, 16, 16}), 0.9, Mirrored()}};
  for (const Case& one : cases) {
    Scene scene{one.voxels};
    scene.options.isovalue = one.isovalue;
    ExpectSame(one.name, scene, LooksAt(scene.voxels.size));
    scene.X_DI = one.placed;
    ExpectSame(one.name, scene, LooksAt(scene.voxels.size));
  }
}

TEST_F(Surface, IsExactFromWithinAndFromTheOtherSide) {
  Scene scene{testing::Gyroid({30, 25, 34})};
  const std::vector<Look> inside{{Vec3(15.0, 12.0, 17.0), Vec3(15.0, 12.0, 2.0)},
                                 {Vec3(3.3, 4.2, 5.1), Vec3(20.0, 22.0, 30.0)}};
  ExpectSame("inside", scene, inside);
  scene.options.free_above = true;
  ExpectSame("free above", scene, LooksAt(scene.voxels.size));
}

// What float would lose far from the origin.
TEST_F(Surface, IsExactAtTheFarEndOfALongVolume) {
  Scene scene{testing::Gyroid({10, 10, 512})};
  const std::vector<Look> looks{{Vec3(4.0, 4.0, 540.0), Vec3(4.0, 4.0, 500.0)},
                                {Vec3(40.0, 30.0, 520.0), Vec3(4.0, 4.0, 500.0)},
                                {Vec3(4.2, 4.1, -20.0), Vec3(4.0, 4.0, 500.0)}};
  ExpectSame("long", scene, looks);
}

TEST_F(Surface, RealVolumesAreExact) {
  const auto folder = testing::DataFolder() / "paper";
  AffineMap lobster_place;
  lobster_place.linear = Vec3(1.0, 1.0, -1.4).asDiagonal();
  const auto lobster = folder / "lobster_301x324x56_uint8.raw.gz";
  const auto daisy = folder / "daisy_192x180x168_uint8.raw.gz";
  if (!std::filesystem::exists(lobster) || !std::filesystem::exists(daisy)) {
    GTEST_SKIP() << "no real volumes at " << folder;
  }
  Scene scene{testing::ReadVoxels<std::uint8_t>(lobster, 0, {301, 324, 56}), lobster_place};
  scene.options.isovalue = 0.16 * 255;
  ExpectSame("lobster", scene, LooksAt(scene.voxels.size));
  scene = {testing::ReadVoxels<std::uint8_t>(daisy, 0, {192, 180, 168})};
  scene.options.isovalue = 0.24 * 254;
  ExpectSame("daisy", scene, LooksAt(scene.voxels.size), kSize);
}

// The surface is in a border of cells and of bricks; voxels are at the isovalue, or
// so near that rounding decides on which side a cell's border is.
TEST_F(Surface, HasNoHolesAtBordersNorHasItsVeil) {
  for (const int plane : {6, 7, 8, 15}) {
    for (const double isovalue : {0.0, 1e-7, 0.5 - 3e-8, 0.5, 1.0 - 1e-7}) {
      Scene scene = Slab(plane);
      scene.options.isovalue = isovalue;
      ExpectSame("slab", scene, LooksAt(scene.voxels.size), kSmallSize);
      scene.options.shown = false;
      scene.options.veil.shown = true;
      scene.options.veil.isovalue = isovalue;
      // Where F stays within a rounding error of the isovalue, so do the layers.
      ExpectSameVeil("slab", scene, kSmallSize, 0.02);
    }
  }
  const Scene sphere{testing::Sphere(64, 30.0)};
  ExpectSame("large sphere", sphere, LooksAt(sphere.voxels.size));
}

Scene CutScene() {
  Scene scene{testing::Gyroid({30, 25, 34})};
  scene.X_DI = Mirrored();
  scene.options.isovalue = 0.2;
  scene.options.window_min = 0.2;
  scene.options.window_max = 1.2;
  return scene;
}

TEST_F(Surface, IsCutByTheCropBoxAndByPlanes) {
  for (const bool caps : {true, false}) {
    Scene scene = CutScene();
    scene.options.caps = caps;
    scene.options.crop.min = Vec3(0.2, 0.0, 0.1);
    scene.options.crop.max = Vec3(0.9, 0.7, 1.0);
    ExpectSame("crop", scene, LooksAt(scene.voxels.size));
    scene.options.planes[0] = {true, Vec3(1.0, 1.0, 0.3).normalized(), 22.0};
    scene.options.planes[1] = {true, -Vec3::UnitZ(), -12.0};
    ExpectSame("crop and planes", scene, LooksAt(scene.voxels.size));
    scene.options.free_above = true;
    ExpectSame("free above, crop and planes", scene, LooksAt(scene.voxels.size));
  }
  // In a plane of the lattice, which is a border of bricks as well.
  Scene scene = CutScene();
  scene.options.planes[0] = {true, Vec3::UnitZ(), 15.0};
  scene.options.planes[1] = {true, -Vec3::UnitX(), -7.0};
  ExpectSame("lattice planes", scene, LooksAt(scene.voxels.size));
}

TEST_F(Surface, ShowsTheValuesAtACut) {
  Scene scene = CutScene();
  scene.options.planes[0] = {true, Vec3(1.0, 1.0, 0.3).normalized(), 22.0};
  const Look look = LooksAt(scene.voxels.size)[9];
  CastRig rig(scene.voxels, scene.X_DI);
  const Picture drawn = rig.Cast(RequestOf(scene, look, kSize));
  const auto expected = testing::ExpectPicture(scene, look, kSize);
  const std::vector<std::uint8_t> table = ColorTable(scene.options.color_map);
  const CpuCaster cpu(scene.voxels, {});
  int caps = 0;
  int differ = 0;
  for (std::size_t n = 0; n < drawn.pixels(); ++n) {
    if (!expected[n].is_cap || !drawn.Shows(n)) continue;
    const double fraction = cpu.Value(expected[n].point_I) - scene.options.window_min;
    const double entry = std::clamp(255.0 * fraction, 0.0, 255.0);
    const auto below = 4 * static_cast<std::size_t>(entry);
    const auto above = std::min(below + 4, 4 * std::size_t{255});
    ++caps;
    for (std::size_t c = 0; c < 3; ++c) {
      const auto [least, most] = std::minmax(table[below + c], table[above + c]);
      if (drawn.color[4 * n + c] < least || drawn.color[4 * n + c] > most) {
        ++differ;
        break;
      }
    }
  }
  EXPECT_GT(caps, 500);
  EXPECT_LE(differ, caps / 500);
}

TEST_F(Surface, IsSeenThroughEveryLayerOfTheVeil) {
  Scene scene = CutScene();
  scene.options.isovalue = 0.9;
  scene.options.veil.shown = true;
  scene.options.veil.isovalue = 0.1;
  scene.options.veil.opacity = 0.08;
  ExpectSameVeil("veil", scene, kOddSize, 0.002);
  scene.options.shown = false;
  ExpectSameVeil("veil alone", scene, kOddSize, 0.002);
}

// Some forty layers, one behind the other.
TEST_F(Surface, BlendsNoMoreLayersThanItSays) {
  Scene scene{MakeVoxels({20, 20, 40}, [](int, int, int k) { return static_cast<float>(k % 2); })};
  scene.options.shown = false;
  scene.options.veil.shown = true;
  scene.options.veil.isovalue = 0.4;
  scene.options.veil.opacity = 0.08;
  ExpectSameVeil("layers", scene, kSmallSize, 0.01);
}

}  // namespace
}  // namespace palpate::view
