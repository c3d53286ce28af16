// Slices against interpolation on the processor.
#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "client/view/drawing/slice_view.h"
#include "tests/support/frame_rig.h"

namespace palpate::view {
namespace {

using testing::Difference;
using testing::FrameRig;
using testing::PixelOf;
using testing::Rgb8;

const Vec3i kSliceLattice = {17, 9, 23};
const Vec3 kSliceVoxel_mm = {1.0, 2.5, 0.7};
constexpr ImageSize kSliceSize = {173, 140};

AffineMap Placement() {
  AffineMap X_DI;
  X_DI.linear =
      Eigen::AngleAxisd(0.6, Vec3(1.0, 2.0, -1.0).normalized()) * kSliceVoxel_mm.asDiagonal();
  X_DI.translation = {4.0, 5.0, 6.0};
  return X_DI;
}

// Nothing that symmetry could hide.
double SliceWaves(const Vec3& p) {
  return 50.0 * std::sin(0.9 * p.x()) + 30.0 * std::cos(1.3 * p.y()) +
         20.0 * std::sin(0.7 * p.z() + 0.2 * p.x());
}

SliceRequest Across(int axis, double position_voxels) {
  SliceRequest request;
  request.picture = axis;
  request.axes = SliceInWorld(axis, SliceSide::kRadiological);
  request.position_voxels = position_voxels;
  request.size = kSliceSize;
  request.surface.window_min = -70.0;
  request.surface.window_max = 80.0;
  request.surface.isovalue = 1e6;
  return request;
}

SliceView ViewOf(const SliceRequest& request) {
  return {request.axes, kSliceLattice, kSliceVoxel_mm, request.size};
}

// Not rounded, 0 to 255.
std::array<double, 3> Mapped(double value, const SurfaceOptions& surface) {
  const auto table = ColorTable(surface.color_map);
  const double share = (value - surface.window_min) / (surface.window_max - surface.window_min);
  const double entry = 255.0 * std::clamp(share, 0.0, 1.0);
  const int below = std::min(static_cast<int>(entry), 254);
  std::array<double, 3> color{};
  for (int channel = 0; channel < 3; ++channel) {
    color[channel] =
        std::lerp(table[4 * below + channel], table[4 * below + 4 + channel], entry - below);
  }
  return color;
}

class ViewSlice : public ::testing::Test {
 protected:
  ViewSlice() {
    rig.Take(testing::VolumeOf(kSliceLattice, SliceWaves, Placement(), -100.0, 100.0));
  }
  ~ViewSlice() override { EXPECT_EQ(glGetError(), static_cast<GLenum>(GL_NO_ERROR)); }

  Image Draw(const SliceRequest& request) {
    EXPECT_NE(rig.DrawSlice(request), 0u);
    return rig.renderer.ReadSlice(request.picture);
  }

  FrameRig rig;
};

TEST_F(ViewSlice, EqualsInterpolationThroughTheColourMap) {
  int inside = 0, outside = 0;
  for (const auto map : {ColorMap::kGray, ColorMap::kHot, ColorMap::kViridis, ColorMap::kBone,
                         ColorMap::kCoolWarm}) {
    for (const auto& [axis, position] :
         {std::pair{0, 7.3}, {1, 4.0}, {2, 11.81}, {0, -0.5}, {1, 9.0}, {2, 22.9}}) {
      SliceRequest request = Across(axis, position);
      request.surface.color_map = map;
      if (map == ColorMap::kHot) std::swap(request.surface.window_min, request.surface.window_max);
      const Image image = Draw(request);
      ASSERT_EQ(image.size, kSliceSize);
      const SliceView view = ViewOf(request);
      for (int y = 0; y < kSliceSize.height; y += 3) {
        for (int x = 0; x < kSliceSize.width; x += 3) {
          const Eigen::Vector2d at_px = {x + 0.5, y + 0.5};
          const Rgb8 seen = PixelOf(image, x, y);
          if (!view.Shows(at_px)) {
            ++outside;
            for (int n = 0; n < 3; ++n) EXPECT_NEAR(seen[n], 255.0f * kEmptySliceColor[n], 1.0);
            continue;
          }
          ++inside;
          const double value = rig.volume.Interpolate(view.PointAt(at_px, position));
          const auto expected = Mapped(value, request.surface);
          for (int n = 0; n < 3; ++n) {
            ASSERT_NEAR(seen[n], expected[n], 1.0) << axis << ' ' << x << ' ' << y;
          }
        }
      }
    }
  }
  EXPECT_GT(inside, 20000);
  EXPECT_GT(outside, 2000);
}

// Of a volume with all axes in another order, two of them against W's.
TEST_F(ViewSlice, ATurnedSliceEqualsInterpolationToo) {
  const PatientAxes axes = {SignedAxis{1, -1}, SignedAxis{2, 1}, SignedAxis{0, -1}};
  for (int picture = 0; picture < 3; ++picture) {
    SliceRequest request = Across(picture, 4.3);
    request.axes = SliceInVolume(picture, SliceSide::kRadiological, axes);
    const Image image = Draw(request);
    const SliceView view = ViewOf(request);
    int inside = 0;
    for (int y = 0; y < kSliceSize.height; y += 3) {
      for (int x = 0; x < kSliceSize.width; x += 3) {
        const Eigen::Vector2d at_px = {x + 0.5, y + 0.5};
        if (!view.Shows(at_px)) continue;
        ++inside;
        const auto expected =
            Mapped(rig.volume.Interpolate(view.PointAt(at_px, 4.3)), request.surface);
        ASSERT_NEAR(PixelOf(image, x, y)[0], expected[0], 1.0) << picture << ' ' << x << ' ' << y;
      }
    }
    EXPECT_GT(inside, 300);
  }
}

// Larger than a block of bricks, with blocks and bricks of one value, and a brick of floats.
TEST(ViewSliceBricks, ASliceAcrossBricksOfAnyKindEqualsInterpolation) {
  const Vec3i lattice = {70, 90, 140};
  for (const LeafType type : {LeafType::kUint8, LeafType::kInt16, LeafType::kFloat}) {
    FrameRig rig;
    testing::VoxelArray voxels = testing::MakeVoxels(lattice, [](int i, int j, int k) {
      const double wave = 50.0 * std::sin(0.3 * i) + 30.0 * std::cos(0.5 * j) + 20.0 * (k % 3);
      return k > 40 ? 60.0f : static_cast<float>(std::round(std::clamp(wave, 0.0, 100.0)));
    });
    rig.Take(testing::WholeVolume(voxels, Placement(), type));
    for (const bool edited : {false, true}) {
      if (edited) {
        voxels.values[(20 * 90 + 30) * 140 + 10] += 0.5f;
        rig.Take(testing::Edit(rig.volume, voxels, {Vec3i(2, 3, 1)}, type));
      }
      for (const auto& [axis, position] : {std::pair{0, 20.3}, {1, 30.2}, {2, 9.8}, {2, 40.6}}) {
        SliceRequest request = Across(axis, position);
        request.surface.window_min = -10.0;
        request.surface.window_max = 110.0;
        rig.DrawSlice(request);
        const Image image = rig.renderer.ReadSlice(axis);
        const SliceView view(request.axes, lattice, kSliceVoxel_mm, request.size);
        for (int y = 0; y < kSliceSize.height; y += 3) {
          for (int x = 0; x < kSliceSize.width; x += 3) {
            const Eigen::Vector2d at_px = {x + 0.5, y + 0.5};
            if (!view.Shows(at_px)) continue;
            const double value = rig.volume.Interpolate(view.PointAt(at_px, position));
            const auto expected = Mapped(value, request.surface);
            ASSERT_NEAR(PixelOf(image, x, y)[0], expected[0], 1.0)
                << Name(type) << ' ' << edited << ' ' << axis << ' ' << x << ' ' << y;
          }
        }
      }
    }
  }
}

TEST(ViewSliceMagnitude, IsNoneOfTheSlices) {
  SliceRequest request = Across(0, 7.3);
  request.surface.isovalue = 12.0;
  request.surface.veil.shown = true;
  request.surface.veil.isovalue = 30.0;
  FrameRig rig;
  const auto draw = [&](double factor, double offset) {
    rig.Take(testing::VolumeOf(
        kSliceLattice, [=](const Vec3& p) { return offset + factor * SliceWaves(p); }, Placement(),
        offset - 100.0 * factor, offset + 100.0 * factor));
    SliceRequest scaled = request;
    for (double* value : {&scaled.surface.isovalue, &scaled.surface.veil.isovalue,
                          &scaled.surface.window_min, &scaled.surface.window_max}) {
      *value = offset + factor * *value;
    }
    rig.DrawSlice(scaled);
    return rig.renderer.ReadSlice(0);
  };
  const Image plain = draw(1.0, 0.0);
  for (const auto& [factor, offset] :
       {std::pair{1e-22, 0.0}, {1e-38, 0.0}, {1e24, 0.0}, {1e36, 0.0}, {1.0, 1e6}}) {
    const Image image = draw(factor, offset);
    // A float's last bit, in colours.
    const double last_bit = 255.0 / 150.0 * offset * 1.2e-7 / factor;
    int differ = 0;
    for (std::size_t n = 0; n < image.rgba.size(); ++n) {
      differ += std::abs(image.rgba[n] - plain.rgba[n]) > 2.0 + 4.0 * last_bit ? 1 : 0;
    }
    EXPECT_LT(differ, 30) << factor << ' ' << offset;
  }
}

TEST_F(ViewSlice, OneBeyondThePaddedLatticeIsEmpty) {
  for (const double position : {-1.5, 24.0}) {
    const Image image = Draw(Across(2, position));
    const Rgb8 corner = PixelOf(image, 0, 0);
    for (int y = 0; y < kSliceSize.height; y += 5) {
      for (int x = 0; x < kSliceSize.width; x += 5) EXPECT_EQ(PixelOf(image, x, y), corner);
    }
    EXPECT_EQ(Difference(corner, {15, 17, 21}), 0);
  }
}

// Along a row across the lattice's x, where values rise evenly.
TEST(ViewSliceIsoline, IsTwoPixelsWideAndWhereTheValueIs) {
  FrameRig rig;
  const Vec3i lattice = {20, 20, 20};
  rig.Take(testing::VolumeOf(
      lattice, [](const Vec3& p) { return p.x(); }, {}, 0.0, 19.0));
  SliceRequest request;
  request.size = {231, 231};  // 11 pixels for a voxel
  request.position_voxels = 10.0;
  request.surface.window_max = 19.0;
  request.surface.isovalue = 7.37;
  request.surface.veil.isovalue = 12.61;
  request.surface.veil.color = {0.0f, 1.0f, 0.0f};
  const SliceView view(request.axes, lattice, Vec3::Ones(), request.size);
  const auto width_px = [&](const Rgb& color, double isovalue) {
    rig.DrawSlice(request);
    const Image image = rig.renderer.ReadSlice(2);
    const double middle_px = view.PixelOf({isovalue, 10.0, 10.0}).x();
    double weight = 0.0, moment = 0.0;
    for (int x = static_cast<int>(middle_px) - 8; x <= middle_px + 8; ++x) {
      const Rgb8 seen = PixelOf(image, x, 115);
      // Grey has no difference between channels.
      const double share = (seen[1] - seen[2]) / (255.0 * (color.y() - color.z()));
      weight += share;
      moment += share * (x + 0.5);
    }
    if (weight > 0.5) {
      EXPECT_NEAR(moment / weight, middle_px, 0.05);
    }
    return weight;
  };
  EXPECT_NEAR(width_px(kIsolineColor, 7.37), 2.0, 0.1);
  EXPECT_NEAR(width_px(request.surface.veil.color, 12.61), 0.0, 0.02);
  request.surface.veil.shown = true;
  EXPECT_NEAR(width_px(request.surface.veil.color, 12.61), 2.0, 0.1);
  EXPECT_NEAR(width_px(kIsolineColor, 7.37), 2.0, 0.1);
}

// Steep values beside the air must not promise a line.
TEST(ViewSliceIsoline, IsNotWhereNoValueIsOnTheOtherSide) {
  FrameRig rig;
  rig.Take(testing::VolumeOf(
      {20, 20, 20}, [](const Vec3& p) { return p.minCoeff() > 11.0 ? 1000.0 : -1000.0; }, {},
      -1000.0, 1000.0));
  SliceRequest request;
  request.size = {231, 231};
  request.position_voxels = 14.0;
  request.surface.window_min = -1000.0;
  request.surface.window_max = 1000.0;
  const auto orange_pixels = [&](double isovalue) {
    request.surface.isovalue = isovalue;
    rig.DrawSlice(request);
    const Image image = rig.renderer.ReadSlice(2);
    int count = 0;
    for (int n = 0; n < 231 * 231; ++n) {
      const Rgb8 seen = PixelOf(image, n % 231, n / 231);
      count += seen[0] > seen[2] + 20;
    }
    return count;
  };
  EXPECT_GT(orange_pixels(0.0), 100);
  for (const double isovalue : {-1000.5, -1001.0, -1100.0, 1000.5, 1001.0, 1100.0}) {
    EXPECT_EQ(orange_pixels(isovalue), 0) << isovalue;
  }
}

TEST_F(ViewSlice, TheCrossHairIsAtItsPoint) {
  for (int axis = 0; axis < 3; ++axis) {
    SliceRequest request = Across(axis, 5.0);
    const Image without = Draw(request);
    request.cross_I = Vec3(9.2, 4.4, 13.7);
    const Image with = Draw(request);
    const Eigen::Vector2d cross_px = ViewOf(request).PixelOf(*request.cross_I);
    const int cross_x = static_cast<int>(cross_px.x()), cross_y = static_cast<int>(cross_px.y());
    for (int y = 0; y < kSliceSize.height; ++y) {
      for (int x = 0; x < kSliceSize.width; ++x) {
        const int away = std::max(std::abs(x - cross_x), std::abs(y - cross_y));
        const bool on_line = (x == cross_x || y == cross_y) && away > 6;
        const bool changed = PixelOf(with, x, y) != PixelOf(without, x, y);
        ASSERT_EQ(changed, on_line) << axis << ' ' << x << ' ' << y;
      }
    }
  }
}

TEST_F(ViewSlice, EachAxisHasAPictureOfItsOwn) {
  const Image x = Draw(Across(0, 3.0));
  SliceRequest request = Across(1, 3.0);
  request.size = {40, 30};
  const Image y = Draw(request);
  EXPECT_EQ(y.size, (ImageSize{40, 30}));
  EXPECT_EQ(rig.renderer.ReadSlice(0).rgba, x.rgba);
  EXPECT_EQ(Draw(Across(0, 3.0)).rgba, x.rgba);
  EXPECT_TRUE(rig.renderer.ReadSlice(2).rgba.empty());
}

TEST_F(ViewSlice, AnEmptyPictureAndAnEmptyWindowAreDrawn) {
  SliceRequest request = Across(0, 3.0);
  request.size = {};
  EXPECT_EQ(rig.DrawSlice(request), 0u);
  EXPECT_TRUE(rig.renderer.ReadSlice(0).rgba.empty());
  request.size = {50, 50};
  request.surface.window_min = request.surface.window_max = 1.0;
  const Image image = Draw(request);
  const Rgb8 middle = PixelOf(image, 25, 25);
  EXPECT_TRUE(middle == (Rgb8{0, 0, 0}) || middle == (Rgb8{255, 255, 255}));
}

TEST_F(ViewSlice, IsDrawnAgainOnlyAfterAChange) {
  SliceRequest request = Across(0, 3.0);
  request.cross_I = Vec3(1.0, 2.0, 3.0);
  const Image first = Draw(request);
  const Image other = Draw(Across(1, 3.0));
  EXPECT_EQ(rig.renderer.slice_casts(), 2u);
  EXPECT_EQ(Draw(request).rgba, first.rgba);
  EXPECT_EQ(Draw(Across(1, 3.0)).rgba, other.rgba);
  rig.renderer.TakeUp(rig.volume, 1000);  // nothing new
  EXPECT_EQ(Draw(request).rgba, first.rgba);
  EXPECT_EQ(rig.renderer.slice_casts(), 2u);

  const std::vector<std::function<void(SliceRequest&)>> changes{
      [](SliceRequest& r) { r.position_voxels += 1.0; },
      [](SliceRequest& r) { r.axes.right = -r.axes.right; },
      [](SliceRequest& r) { r.size.width -= 10; },
      [](SliceRequest& r) { r.surface.isovalue = 10.0; },
      [](SliceRequest& r) { r.surface.color_map = ColorMap::kHot; },
      [](SliceRequest& r) { r.cross_I->y() += 1.0; },
      [](SliceRequest& r) { r.cross_I.reset(); }};
  Image last = first;
  for (const auto& change : changes) {
    change(request);
    const Image now = Draw(request);
    EXPECT_NE(now.rgba, last.rgba);
    last = now;
  }
  EXPECT_EQ(rig.renderer.slice_casts(), 2 + changes.size());

  rig.Take(testing::VolumeOf(
      kSliceLattice, [](const Vec3& p) { return p.x(); }, Placement(), -100.0, 100.0));
  EXPECT_NE(Draw(request).rgba, last.rgba);
  EXPECT_EQ(rig.renderer.slice_casts(), 3 + changes.size());
}

TEST(ViewSliceEmpty, WithoutAVolumeThereIsAnEmptyPicture) {
  FrameRig rig;
  SliceRequest request;
  request.size = {30, 20};
  request.cross_I = Vec3::Zero();
  rig.DrawSlice(request);
  const Image image = rig.renderer.ReadSlice(2);
  ASSERT_EQ(image.rgba.size(), 30u * 20u * 4u);
  for (int x = 0; x < 30; ++x) EXPECT_EQ(PixelOf(image, x, 10), (Rgb8{15, 17, 21}));
}

}  // namespace
}  // namespace palpate::view
