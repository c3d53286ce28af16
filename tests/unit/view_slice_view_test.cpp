#include "client/view/drawing/slice_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

namespace palpate::view {
namespace {

using Eigen::Vector2d;

constexpr ImageSize kSliceSize = {301, 200};
const Vec3i kLattice = {40, 30, 20};
const Vec3 kVoxel_mm = {0.5, 1.0, 2.5};

// Across each axis, upright, turned and mirrored.
const SliceAxes kSlices[] = {{{0, 1}, {1, 1}, {2, -1}}, {{1, 1}, {0, 1}, {2, -1}},
                             {{2, 1}, {0, 1}, {1, 1}},  {{0, -1}, {2, 1}, {1, -1}},
                             {{1, 1}, {2, -1}, {0, 1}}, {{2, 1}, {1, -1}, {0, -1}}};

TEST(ViewSliceView, PixelsAndPointsAreInverse) {
  for (const SliceAxes& axes : kSlices) {
    const int axis = axes.across.axis;
    const SliceView view(axes, kLattice, kVoxel_mm, kSliceSize);
    for (const Vector2d& px : {Vector2d(0.5, 0.5), Vector2d(150.0, 99.25), Vector2d(-7.0, 230.0)}) {
      const Vec3 p_I = view.PointAt(px, 7.25);
      EXPECT_EQ(p_I[axis], 7.25);
      EXPECT_LT((view.PixelOf(p_I) - px).norm(), 1e-9) << axis;
    }
    const Vec3 p_I = {3.5, 11.0, 6.75};
    EXPECT_LT((view.PointAt(view.PixelOf(p_I), p_I[axis]) - p_I).norm(), 1e-9) << axis;
  }
}

TEST(ViewSliceView, EachAxisRunsAsItIsTold) {
  for (const SliceAxes& axes : kSlices) {
    const SliceView view(axes, kLattice, kVoxel_mm, kSliceSize);
    const auto step = [&](int axis) {
      return Vector2d(view.PixelOf(Vec3::Unit(axis)) - view.PixelOf(Vec3::Zero()));
    };
    EXPECT_GT(axes.right.sign * step(axes.right.axis).x(), 0.0);
    EXPECT_EQ(step(axes.right.axis).y(), 0.0);
    EXPECT_GT(axes.down.sign * step(axes.down.axis).y(), 0.0);
    EXPECT_EQ(step(axes.down.axis).x(), 0.0);
    EXPECT_EQ(step(axes.across.axis), Vector2d::Zero());
  }
}

TEST(ViewSliceView, VoxelsHaveTheirPhysicalShape) {
  for (const SliceAxes& axes : kSlices) {
    const SliceView view(axes, kLattice, kVoxel_mm, kSliceSize);
    const Vector2d px_per_mm = {std::abs(view.px_per_voxel().x()) / kVoxel_mm[axes.right.axis],
                                std::abs(view.px_per_voxel().y()) / kVoxel_mm[axes.down.axis]};
    EXPECT_NEAR(px_per_mm.x(), px_per_mm.y(), 1e-12) << axes.across.axis;
  }
}

TEST(ViewSliceView, ThePaddedLatticeTouchesTheNearerBordersAndIsCentred) {
  for (const ImageSize& size : {ImageSize{400, 100}, ImageSize{100, 400}}) {
    for (const SliceAxes& axes : kSlices) {
      const int axis = axes.across.axis;
      const SliceView view(axes, kLattice, kVoxel_mm, size);
      const Vector2d a = view.PixelOf(Vec3::Constant(-1.0));
      const Vector2d b = view.PixelOf(kLattice.cast<double>());
      const Vector2d picture = {size.width, size.height};
      const Vector2d min = a.cwiseMin(b), max = a.cwiseMax(b);
      EXPECT_LT((min + max - picture).norm(), 1e-9) << axis;
      EXPECT_GE(min.minCoeff(), -1e-9) << axis;
      EXPECT_NEAR(min.minCoeff(), 0.0, 1e-9) << axis;
      EXPECT_TRUE(view.Shows(0.5 * picture));
      EXPECT_TRUE(view.Shows(min + Vector2d::Constant(0.01)));
      EXPECT_FALSE(view.Shows(min - Vector2d::Constant(0.01)));
      EXPECT_FALSE(view.Shows(max + Vector2d::Constant(0.01)));
    }
  }
}

TEST(ViewSliceView, AnEmptyPictureGivesFinitePoints) {
  const SliceView view(kSlices[2], kLattice, kVoxel_mm, {});
  EXPECT_TRUE(view.PointAt({0.0, 0.0}, 0.0).allFinite());
}

class ZoomDice {
 public:
  double Between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vector2d PointOf(const ImageSize& size) {
    return {Between(0.0, size.width), Between(0.0, size.height)};
  }

 private:
  std::mt19937 random_{13};
};

TEST(ViewSliceView, WhateverIsZoomedAndMovedPixelsAndPointsAreInverse) {
  ZoomDice dice;
  for (const SliceAxes& axes : kSlices) {
    SliceZoom zoom;
    for (int n = 0; n < 2000; ++n) {
      const SliceView view(axes, kLattice, kVoxel_mm, kSliceSize, zoom);
      const Vector2d px = dice.PointOf(kSliceSize);
      const Vec3 p_I = view.PointAt(px, 7.25);
      ASSERT_TRUE(p_I.allFinite());
      ASSERT_LT((view.PixelOf(p_I) - px).norm(), 1e-8);
      const auto [axis, across] = std::pair(axes.right.axis, axes.down.axis);
      const bool is_in = p_I[axis] >= -1.0 && p_I[axis] <= kLattice[axis] && p_I[across] >= -1.0 &&
                         p_I[across] <= kLattice[across];
      ASSERT_EQ(view.Shows(px), is_in);
      // The lattice cannot be lost.
      ASSERT_TRUE(view.Shows({150.5, 100.0}));
      zoom = n % 2 ? view.ZoomedAt(px, std::exp(dice.Between(-1.0, 1.1)))
                   : view.MovedBy({dice.Between(-900, 900), dice.Between(-900, 900)});
      ASSERT_GE(zoom.factor, 1.0);
      ASSERT_LE(zoom.factor, SliceZoom::kMost);
    }
  }
}

TEST(ViewSliceView, AZoomKeepsThePointUnderThePointerAndADragTakesItAlong) {
  ZoomDice dice;
  for (const SliceAxes& axes : kSlices) {
    const SliceView before(axes, kLattice, kVoxel_mm, kSliceSize, {3.0, {1.5, -2.0}});
    // Near enough to the middle that the picture's middle stays on the lattice.
    const Vector2d px = Vector2d(150.5, 100.0) + Vector2d(dice.Between(-30, 30), 12.0);
    const Vec3 p_I = before.PointAt(px, 3.0);
    const SliceView nearer(axes, kLattice, kVoxel_mm, kSliceSize, before.ZoomedAt(px, 2.5));
    EXPECT_LT((nearer.PixelOf(p_I) - px).norm(), 1e-9);
    EXPECT_LT((nearer.px_per_voxel() - 2.5 * before.px_per_voxel()).norm(), 1e-9);
    const Vector2d drag(7.0, -11.0);
    const SliceView moved(axes, kLattice, kVoxel_mm, kSliceSize, before.MovedBy(drag));
    EXPECT_LT((moved.PixelOf(p_I) - px - drag).norm(), 1e-9);
    EXPECT_EQ(moved.px_per_voxel(), before.px_per_voxel());
    // All the way out is the whole slice again.
    EXPECT_EQ(before.ZoomedAt(px, 0.01), SliceZoom());
  }
}

TEST(ViewSliceView, AZoomShowsTheSameInAPictureOfAnotherSize) {
  const SliceZoom zoom{4.0, {6.0, -3.0}};
  for (const SliceAxes& axes : kSlices) {
    const SliceView small(axes, kLattice, kVoxel_mm, {200, 200}, zoom);
    const SliceView large(axes, kLattice, kVoxel_mm, {800, 800}, zoom);
    EXPECT_LT((small.PointAt({40, 90}, 1.0) - large.PointAt({160, 360}, 1.0)).norm(), 1e-9);
  }
}

TEST(ViewSliceView, EdgesOfAVoxelAreThoseOfItsMap) {
  EXPECT_EQ(VoxelEdges({}), Vec3::Ones());
  AffineMap X_DI;
  X_DI.linear = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()) * kVoxel_mm.asDiagonal();
  X_DI.translation = {5, 6, 7};
  EXPECT_LT((VoxelEdges(X_DI) - kVoxel_mm).norm(), 1e-12);
}

}  // namespace
}  // namespace palpate::view
