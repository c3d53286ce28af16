// The surface that is drawn is the exact one: whole, cut, veiled, of real volumes, whatever the
// magnitude of values; and its light looks right.

#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "client/view/drawing/value_window.h"
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
using testing::VoxelArray;

class Surface : public testing::SurfaceRig {};

TEST_F(Surface, IsExactWhateverItIsAndHoweverItIsPlaced) {
  struct Case {
    const char* name;
    VoxelArray voxels;
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

// Reads the bytes of a gzipped file, x fastest.
VoxelArray ReadVoxels(const std::filesystem::path& path, const Vec3i& size) {
  const gzFile stream = gzopen(path.c_str(), "rb");
  std::vector<std::uint8_t> values(static_cast<std::size_t>(size.prod()));
  const auto bytes = static_cast<unsigned>(values.size());
  const int read = gzread(stream, values.data(), bytes);
  gzclose(stream);
  if (read != static_cast<int>(bytes)) throw std::runtime_error("cannot read " + path.string());
  return MakeVoxels(size, [&](int i, int j, int k) {
    const std::size_t at = (static_cast<std::size_t>(k) * size.y() + j) * size.x() + i;
    return static_cast<float>(values[at]);
  });
}

TEST_F(Surface, RealVolumesAreExact) {
  const auto folder = testing::DataFolder() / "paper";
  const auto lobster = folder / "lobster_301x324x56_uint8.raw.gz";
  const auto daisy = folder / "daisy_192x180x168_uint8.raw.gz";
  if (!std::filesystem::exists(lobster) || !std::filesystem::exists(daisy)) {
    GTEST_SKIP() << "no real volumes at " << folder;
  }
  Scene scene{ReadVoxels(lobster, {301, 324, 56}),
              {Mat3(Vec3(1.0, 1.0, -1.4).asDiagonal()), Vec3::Zero()}};
  scene.options.isovalue = 0.16 * 255;
  ExpectSame("lobster", scene, LooksAt(scene.voxels.size));
  scene = {ReadVoxels(daisy, {192, 180, 168})};
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

// --- The magnitude of values, and light

class SurfaceValues : public Surface {};

VoxelArray Scaled(const VoxelArray& voxels, double factor, double offset) {
  return MakeVoxels(voxels.size, [&](int i, int j, int k) {
    return static_cast<float>(offset + factor * voxels.At(i, j, k));
  });
}

struct Magnitude {
  double factor;
  double offset;
};
// Squares of some of these are nothing, or infinite, to a float. In the last, a value's
// last bit is a sixteenth of what it rises from voxel to voxel.
const Magnitude kMagnitudes[] = {{1e-22, 0.0}, {1e-37, 0.0}, {1e20, 0.0},
                                 {1e24, 0.0},  {1e37, 0.0},  {1.0, 1e6}};

TEST_F(SurfaceValues, IsExactWhateverTheMagnitudeOfValues) {
  for (const auto& [factor, offset] : kMagnitudes) {
    const std::string name = std::to_string(std::log10(factor)) + ", " + std::to_string(offset);
    Scene scene{Scaled(testing::Gyroid({30, 25, 34}), factor, offset)};
    // No float.
    scene.options.isovalue = offset + 0.2037 * factor;
    ExpectSame("gyroid " + name, scene, LooksAt(scene.voxels.size));
    scene.options.planes[0] = {true, Vec3(1.0, 1.0, 0.3).normalized(), 22.0};
    ExpectSame("cut gyroid " + name, scene, LooksAt(scene.voxels.size));
    scene.options.shown = false;
    scene.options.veil = {.shown = true, .isovalue = offset + 0.5 * factor, .opacity = 0.08};
    scene.options.planes[0].on = false;
    ExpectSameVeil("veil " + name, scene, kSmallSize, 0.01);
  }
}

// Voxels at the isovalue are on its lower side, and those a bit above on the other.
TEST_F(SurfaceValues, HasNoHolesAtBordersWhateverTheMagnitudeOfValues) {
  constexpr int kPlane = 7;
  for (const auto& [factor, offset] : kMagnitudes) {
    Scene scene = Slab(kPlane);
    scene.voxels = Scaled(scene.voxels, factor, offset);
    const float middle = scene.voxels.At(3, 3, kPlane);
    for (const double isovalue :
         {static_cast<double>(middle),
          0.5 * (middle + static_cast<double>(std::nextafter(middle, -1e38f))),
          middle + 1e-12 * factor, offset}) {
      scene.options.isovalue = isovalue;
      ExpectSame("slab", scene, LooksAt(scene.voxels.size), kSmallSize);
    }
  }
}

// A voxel that an edit makes larger than all that the volume said it had.
TEST_F(SurfaceValues, IsExactBesideValuesOfAnotherMagnitude) {
  Scene scene{testing::Sphere(26, 9.0)};
  CastRig rig(scene.voxels);
  for (int n = 0; n < 40; ++n) scene.voxels.values[static_cast<std::size_t>(391 * n)] = 3e38f;
  std::vector<Vec3i> bricks;
  for (int n = 0; n < 64; ++n) bricks.push_back({n >> 4, n >> 2 & 3, n & 3});
  rig.volume.Take(testing::Edit(rig.volume, scene.voxels, bricks));
  rig.cache.TakeUp(rig.volume, SIZE_MAX);
  const Look look = LooksAt(scene.voxels.size)[9];
  const CastRequest request = RequestOf(scene, look, kOddSize);
  const auto expected = testing::ExpectPicture(scene, look, kOddSize);
  const testing::Comparison c = testing::Compare(scene, look, request, rig.Cast(request), expected);
  EXPECT_GT(c.both, 1000);
  EXPECT_LE(c.far, 0.001 * c.both);
  EXPECT_EQ(c.wrong, 0);
}

// The part of the pixels that differ by more than rounding.
double DifferentPart(const Picture& a, const Picture& b, int tolerance) {
  std::size_t differ = 0;
  for (std::size_t n = 0; n < a.color.size(); ++n) {
    differ += std::abs(a.color[n] - b.color[n]) > tolerance ? 1 : 0;
  }
  return static_cast<double>(differ) / static_cast<double>(a.color.size());
}

TEST_F(SurfaceValues, IsLitTheSameWhateverTheMagnitudeOfValues) {
  for (const SurfaceColoring coloring : {SurfaceColoring::kPlain, SurfaceColoring::kSlope}) {
    Scene scene{testing::Sphere(32, 10.0)};
    scene.options.coloring = coloring;
    scene.options.color_map = ColorMap::kViridis;
    scene.options.planes[0] = {true, Vec3(1.0, 1.0, 0.3).normalized(), 38.0};
    scene.options.window_max = 10.0;
    const Look look = LooksAt(scene.voxels.size)[9];
    const Picture plain = CastRig(scene.voxels).Cast(RequestOf(scene, look, kSize));
    for (const auto& [factor, offset] : kMagnitudes) {
      Scene scaled = scene;
      scaled.voxels = Scaled(scene.voxels, factor, offset);
      scaled.options.isovalue = offset;
      scaled.options.window_min = offset;
      scaled.options.window_max = offset + 10.0 * factor;
      const Picture drawn = CastRig(scaled.voxels).Cast(RequestOf(scaled, look, kSize));
      // Where the voxels themselves are rounded, so are the normals.
      EXPECT_LT(DifferentPart(drawn, plain, offset == 0.0 ? 2 : 24), 0.01)
          << factor << ' ' << offset;
    }
  }
}

// Of a pixel, how far its brightness is beyond that of all that show around it.
int Outlier(const Picture& picture, int x, int y) {
  const auto brightness = [&](std::size_t n) {
    return picture.color[4 * n] + picture.color[4 * n + 1] + picture.color[4 * n + 2];
  };
  const auto at = [&](int u, int v) {
    return static_cast<std::size_t>(v * picture.size.width + u);
  };
  int least = 3 * 255;
  int most = 0;
  int around = 0;
  for (int v = y - 1; v <= y + 1; ++v) {
    for (int u = x - 1; u <= x + 1; ++u) {
      if ((u == x && v == y) || !picture.Shows(at(u, v))) continue;
      least = std::min(least, brightness(at(u, v)));
      most = std::max(most, brightness(at(u, v)));
      ++around;
    }
  }
  if (around < 2) return 0;
  const int own = brightness(at(x, y));
  return std::max(own - most, least - own);
}

// Normals for light are smoother than the surface, so that those of its outermost pixels
// may point away from the eye.
TEST_F(SurfaceValues, HasNoBrightPixelsAlongItsSilhouette) {
  Scene scene{testing::Sphere(32, 10.0)};
  for (const AffineMap& X_DI : {AffineMap{}, Mirrored()}) {
    scene.X_DI = X_DI;
    CastRig rig(scene.voxels, scene.X_DI);
    for (const Look& look : LooksAt(scene.voxels.size)) {
      const Picture drawn = rig.Cast(RequestOf(scene, look, {241, 181}));
      int worst = 0;
      for (int y = 1; y < 180; ++y) {
        for (int x = 1; x < 240; ++x) {
          if (drawn.Shows(static_cast<std::size_t>(y * 241 + x))) {
            worst = std::max(worst, Outlier(drawn, x, y));
          }
        }
      }
      EXPECT_LE(worst, 100) << look.eye_I.transpose();
    }
  }
}

TEST_F(SurfaceValues, IsLitAndColoured) {
  Scene scene{testing::Sphere(26, 9.0)};
  const Look look{Vec3(12.0, 12.0, 60.0), Vec3(12.7, 12.7, 12.7)};
  CastRig rig(scene.voxels);
  scene.options.color = Rgb(0.9f, 0.2f, 0.2f);
  const Picture plain = rig.Cast(RequestOf(scene, look, kSize));
  const auto at = [](int x, int y) { return 4 * static_cast<std::size_t>(y * kSize.width + x); };
  const auto middle = at(80, 60);
  EXPECT_GT(plain.color[middle], 2 * plain.color[middle + 1]);
  // The lamp is above, on the left.
  EXPECT_GT(plain.color[at(70, 70)], plain.color[at(90, 50)] + 10);

  scene.options.coloring = SurfaceColoring::kHeight;
  const Picture height = rig.Cast(RequestOf(scene, look, kSize));
  EXPECT_NE(height.color, plain.color);
  EXPECT_EQ(height.depth, plain.depth);
  scene.options.coloring = SurfaceColoring::kSlope;
  EXPECT_NE(rig.Cast(RequestOf(scene, look, kSize)).color, height.color);
}

}  // namespace
}  // namespace palpate::view
