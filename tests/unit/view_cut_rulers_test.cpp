// Cuts in mm, in lattices that lie in every direction.
#include "client/view/drawing/cut_rulers.h"

#include <gtest/gtest.h>

#include "client/view/drawing/cut_handles.h"

namespace palpate::view {
namespace {

const Vec3i kLatticeSize(40, 50, 60);

// The voxels' x, y and z along any axes of W, in either direction.
std::vector<AffineMap> Maps() {
  std::vector<AffineMap> maps;
  for (int turn = 0; turn < 3; ++turn) {
    for (int mirrored = 0; mirrored < 8; ++mirrored) {
      AffineMap X_WI;
      X_WI.linear.setZero();
      for (int axis = 0; axis < 3; ++axis) {
        X_WI.linear((axis + turn) % 3, axis) = (mirrored >> axis & 1 ? -1.0 : 1.0) * (0.5 + axis);
      }
      X_WI.translation = Vec3(-17.0, 3.0, 120.0);
      maps.push_back(X_WI);
    }
  }
  return maps;
}

TEST(CutRulers, FacesAreWhereTheWorldHasThem) {
  for (const AffineMap& X_WI : Maps()) {
    const CropBox crop{.min = Vec3(0.1, 0.2, 0.3), .max = Vec3(0.6, 0.7, 0.9)};
    const Vec3 one_W = X_WI.Apply(PointOfFractions(crop.min, kLatticeSize));
    const Vec3 other_W = X_WI.Apply(PointOfFractions(crop.max, kLatticeSize));
    const auto rulers = RulersOf(X_WI, kLatticeSize);
    CropBox again;
    for (int axis = 0; axis < 3; ++axis) {
      const CutRuler& ruler = rulers[static_cast<std::size_t>(axis)];
      const auto faces_mm = FacesOnRuler(crop, ruler);
      EXPECT_NEAR(faces_mm[0], std::min(one_W[axis], other_W[axis]), 1e-9);
      EXPECT_NEAR(faces_mm[1], std::max(one_W[axis], other_W[axis]), 1e-9);
      EXPECT_LT(ruler.begin_mm, faces_mm[0]);
      EXPECT_GT(ruler.end_mm, faces_mm[1]);
      SetFacesOnRuler(faces_mm, ruler, again);
    }
    EXPECT_NEAR((again.min - crop.min).norm() + (again.max - crop.max).norm(), 0.0, 1e-12);
  }
}

TEST(CutRulers, FacesStayApartAndInTheVolume) {
  for (const AffineMap& X_WI : Maps()) {
    for (const CutRuler& ruler : RulersOf(X_WI, kLatticeSize)) {
      for (const auto& faces_mm : {std::array{-1e6, -1e5}, std::array{1e5, 1e6},
                                   std::array{3.0, 3.0}, std::array{1e6, -1e6}}) {
        CropBox crop;
        SetFacesOnRuler(faces_mm, ruler, crop);
        const int axis = ruler.along_I.axis;
        EXPECT_GE(crop.min[axis], 0.0);
        EXPECT_LE(crop.max[axis], 1.0);
        EXPECT_GE(crop.max[axis] - crop.min[axis], kLeastCrop - 1e-12);
      }
    }
  }
}

TEST(CutRulers, APlaneIsAsFarFromTheMiddleAsItsPointsAre) {
  for (const AffineMap& X_WI : Maps()) {
    const Vec3 normal_I = Vec3(1.0, -2.0, 0.5).normalized();
    const Vec3 normal_W = (X_WI.Inverse().linear.transpose() * normal_I).normalized();
    const Vec3 middle_W = X_WI.Apply(0.5 * (kLatticeSize - Vec3i::Ones()).cast<double>());
    for (const double distance_mm : {-7.5, 0.0, 12.0}) {
      const Vec3 p_I = X_WI.Inverse().Apply(middle_W + distance_mm * normal_W);
      const double offset_voxels = normal_I.dot(p_I);
      EXPECT_NEAR(DistanceOfPlane(offset_voxels, normal_I, X_WI, kLatticeSize), distance_mm, 1e-9);
      EXPECT_NEAR(OffsetOfPlane(distance_mm, normal_I, X_WI, kLatticeSize), offset_voxels, 1e-9);
    }
  }
}

}  // namespace
}  // namespace palpate::view
