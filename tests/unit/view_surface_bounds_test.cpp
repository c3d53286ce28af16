#include "client/view/drawing/surface_bounds.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/view_volumes.h"

namespace palpate::view {
namespace {

TEST(ViewSurfaceBounds, TheyAreAroundTheSurfaceWithLessThanTwoBricksMore) {
  const Vec3 center_I = {70.0, 15.0, 40.0};
  constexpr double kRadius = 6.0, kPeak = 14.0;
  const auto voxels = testing::MakeVoxels({150, 30, 61}, [&](int i, int j, int k) {
    // 0 far away, as the background is: otherwise there is a surface at the lattice's end.
    return static_cast<float>(std::max(0.0, kPeak - (Vec3(i, j, k) - center_I).norm()));
  });
  const AffineMap X_DI{Mat3(Vec3(0.5, -2.0, 1.0).asDiagonal()), Vec3(3.0, 4.0, 5.0)};
  ViewVolume volume;
  EXPECT_FALSE(SurfaceBounds(volume, kPeak - kRadius));
  volume.Take(testing::WholeVolume(voxels, X_DI));
  const auto bounds = SurfaceBounds(volume, kPeak - kRadius);
  ASSERT_TRUE(bounds);
  const Vec3 scale = Vec3(0.5, 2.0, 1.0);
  const Vec3 center_D = X_DI.Apply(center_I);
  EXPECT_TRUE((bounds->min_mm.array() <= (center_D - kRadius * scale).array()).all());
  EXPECT_TRUE((bounds->max_mm.array() >= (center_D + kRadius * scale).array()).all());
  EXPECT_TRUE((bounds->min_mm.array() >= (center_D - (kRadius + 8.0) * scale).array()).all());
  EXPECT_TRUE((bounds->max_mm.array() <= (center_D + (kRadius + 8.0) * scale).array()).all());
  EXPECT_FALSE(SurfaceBounds(volume, -1.0));
}

}  // namespace
}  // namespace palpate::view
