#include "client/view/scene/slice_view.h"

#include <gtest/gtest.h>

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

TEST(ViewSliceView, EdgesOfAVoxelAreThoseOfItsMap) {
  EXPECT_EQ(VoxelEdges({}), Vec3::Ones());
  AffineMap X_DI;
  X_DI.linear = Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()) * kVoxel_mm.asDiagonal();
  X_DI.translation = {5, 6, 7};
  EXPECT_LT((VoxelEdges(X_DI) - kVoxel_mm).norm(), 1e-12);
}

}  // namespace
}  // namespace palpate::view
