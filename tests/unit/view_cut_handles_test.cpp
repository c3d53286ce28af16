// Handles of crop box and planes, under random cameras and in random places of the volume; and cuts
// in mm, in lattices that lie in every direction.
#include <gtest/gtest.h>

#include <random>

#include "client/view/drawing/cut_handles.h"

namespace palpate::view {

namespace {

using Eigen::Vector2d;

constexpr ImageSize kViewSize{800, 600};

class CutHandles : public ::testing::Test {
 protected:
  double Random(double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(random_);
  }
  Vec3 RandomDirection() {
    Vec3 direction;
    do {
      direction = Vec3(Random(-1, 1), Random(-1, 1), Random(-1, 1));
    } while (direction.norm() < 0.1 || direction.norm() > 1.0);
    return direction.normalized();
  }
  // A turned lattice with other spacings along each axis, cut by all.
  CutScene RandomScene() {
    CutScene scene;
    scene.lattice_size = Vec3i(20 + static_cast<int>(Random(0, 100)), 64, 33);
    const Mat3 turn =
        Eigen::Quaterniond::FromTwoVectors(Vec3::UnitX(), RandomDirection()).toRotationMatrix();
    scene.X_DI.linear = turn * Vec3(Random(0.3, 2), Random(0.3, 2), Random(0.3, 2)).asDiagonal();
    const Vec3 middle_I = 0.5 * (scene.lattice_size - Vec3i::Ones()).cast<double>();
    scene.X_DI.translation = -(scene.X_DI.linear * middle_I);
    for (int axis = 0; axis < 3; ++axis) {
      scene.cuts.crop.min[axis] = Random(0.0, 0.45);
      scene.cuts.crop.max[axis] = Random(0.55, 1.0);
    }
    for (std::size_t n = 0; n < kClipPlanes; ++n) {
      ClipPlane& plane = scene.cuts.planes[n];
      plane = {.on = true, .normal_I = RandomDirection()};
      scene.pivots_I[n] = middle_I;
      plane.offset_voxels = plane.normal_I.dot(middle_I) + Random(-5, 5);
    }
    return scene;
  }
  Camera RandomCamera() {
    Camera camera;
    camera.Set(Vec3(Random(-10, 10), Random(-10, 10), Random(-10, 10)), Random(-180, 180),
               Random(-85, 85), Random(250, 500));
    return camera;
  }
  // A place of the picture where the pointer takes this handle; none found: it is hidden by others
  // or points to the eye.
  std::optional<Vector2d> PlaceOf(const CutScene& scene, const CutHandle& handle,
                                  const Projection& projection) {
    for (int n = 0; n < 500; ++n) {
      const Vector2d at_px(Random(0, kViewSize.width), Random(0, kViewSize.height));
      if (HandleAt(scene, projection, at_px) == handle) return at_px;
    }
    return std::nullopt;
  }
  static void ExpectWithin(const CutScene& scene) {
    const Cuts& cuts = scene.cuts;
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_GE(cuts.crop.min[axis], 0.0);
      EXPECT_LE(cuts.crop.max[axis], 1.0);
      EXPECT_GE(cuts.crop.max[axis] - cuts.crop.min[axis], kLeastCrop - 1e-12);
    }
    for (const ClipPlane& plane : cuts.planes) {
      EXPECT_NEAR(plane.normal_I.norm(), 1.0, 1e-9);
      const auto [least, most] = OffsetRange(plane.normal_I, scene.lattice_size);
      EXPECT_GE(plane.offset_voxels, least - 1e-9);
      EXPECT_LE(plane.offset_voxels, most + 1e-9);
    }
  }

  std::mt19937 random_{42};
};

// All but what the handle is for stays, and the handle is where the pointer went.
TEST_F(CutHandles, StayUnderThePointer) {
  int dragged = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const CutScene scene = RandomScene();
    const Projection projection(RandomCamera(), kViewSize);
    const Vector2d at_px(Random(0, kViewSize.width), Random(0, kViewSize.height));
    const std::optional<CutHandle> handle = HandleAt(scene, projection, at_px);
    if (!handle) continue;
    const CutDrag drag(*handle, scene, projection, at_px);
    const CutScene rest = drag.At(projection, at_px);
    EXPECT_NEAR((rest.cuts.crop.min - scene.cuts.crop.min).norm(), 0.0, 1e-9);
    EXPECT_NEAR((rest.cuts.crop.max - scene.cuts.crop.max).norm(), 0.0, 1e-9);
    for (std::size_t n = 0; n < kClipPlanes; ++n) {
      EXPECT_NEAR((rest.cuts.planes[n].normal_I - scene.cuts.planes[n].normal_I).norm(), 0, 1e-9);
      EXPECT_NEAR(rest.cuts.planes[n].offset_voxels, scene.cuts.planes[n].offset_voxels, 1e-6);
    }
    const Vector2d to_px = at_px + Vector2d(Random(-15, 15), Random(-15, 15));
    const CutScene moved = drag.At(projection, to_px);
    ExpectWithin(moved);
    // It can be taken again where it was left: it followed the pointer across its line, or has
    // reached an end.
    if (handle->kind != CutHandle::Kind::kRim) {
      const CutScene again = CutDrag(*handle, moved, projection, to_px).At(projection, to_px);
      EXPECT_NEAR((again.cuts.crop.min - moved.cuts.crop.min).norm(), 0.0, 1e-9);
      // There and back is the same as never moved.
      const CutScene back = drag.At(projection, at_px);
      EXPECT_EQ(back.cuts.crop, rest.cuts.crop);
    }
    ++dragged;
  }
  EXPECT_GT(dragged, 40);
}

// The face of the box is where the pointer went along the face's axis, exactly.
TEST_F(CutHandles, AFaceFollowsThePointerAlongItsAxis) {
  int followed = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const CutScene scene = RandomScene();
    const Projection projection(RandomCamera(), kViewSize);
    const std::size_t face = static_cast<std::size_t>(Random(0, 5.999));
    const auto axis = static_cast<int>(face / 2);
    // A point on the arrow, and one farther along the same line.
    const auto point = [&](double more) {
      Vec3 fractions = 0.5 * (scene.cuts.crop.min + scene.cuts.crop.max);
      fractions[axis] =
          face % 2 == 1 ? scene.cuts.crop.max[axis] + more : scene.cuts.crop.min[axis] - more;
      return projection.PixelOf(scene.X_DI.Apply(PointOfFractions(fractions, scene.lattice_size)));
    };
    const double more = Random(-0.09, 0.0);
    const auto from = point(0.0), to = point(more);
    ASSERT_TRUE(from && to);
    const CutHandle handle{CutHandle::Kind::kFace, face};
    if ((*from - *to).norm() < 2.0) continue;
    const CutScene moved = CutDrag(handle, scene, projection, *from).At(projection, *to);
    const double wanted =
        face % 2 == 1 ? scene.cuts.crop.max[axis] + more : scene.cuts.crop.min[axis] - more;
    EXPECT_NEAR(face % 2 == 1 ? moved.cuts.crop.max[axis] : moved.cuts.crop.min[axis], wanted,
                1e-6);
    ++followed;
  }
  EXPECT_GT(followed, 200);
}

// Wherever the pointer goes, also beyond the point where the arrow's line vanishes.
TEST_F(CutHandles, ADragFarAwayStaysWithinTheVolume) {
  for (int trial = 0; trial < 300; ++trial) {
    const CutScene scene = RandomScene();
    const Projection projection(RandomCamera(), kViewSize);
    for (std::size_t number = 0; number < 6; ++number) {
      for (const auto kind :
           {CutHandle::Kind::kFace, CutHandle::Kind::kPlane, CutHandle::Kind::kRim}) {
        const CutHandle handle{kind, kind == CutHandle::Kind::kFace ? number : number % 2};
        const CutDrag drag(handle, scene, projection, Vector2d(Random(0, 800), Random(0, 600)));
        ExpectWithin(drag.At(projection, Vector2d(Random(-9000, 9000), Random(-9000, 9000))));
      }
    }
  }
}

// The plane turns about the middle of its disc, and the place where it was taken stays under the
// pointer while the pointer is over the ball in which the disc can turn.
TEST_F(CutHandles, ARimTurnsItsPlaneAboutTheDisc) {
  int turned = 0;
  for (int trial = 0; trial < 200 && turned < 15; ++trial) {
    CutScene scene = RandomScene();
    const Projection projection(RandomCamera(), kViewSize);
    const CutHandle handle{CutHandle::Kind::kRim, 0};
    const std::optional<Vector2d> at_px = PlaceOf(scene, handle, projection);
    if (!at_px) continue;
    const CutDrag drag(handle, scene, projection, *at_px);
    // To a place over the ball: inwards from the rim.
    const Vec3 pivot_D = scene.X_DI.Apply(drag.At(projection, *at_px).pivots_I[0]);
    const auto middle_px = projection.PixelOf(pivot_D);
    ASSERT_TRUE(middle_px);
    const Vector2d to_px = *at_px + 0.4 * (*middle_px - *at_px);
    const CutScene moved = drag.At(projection, to_px);
    EXPECT_TRUE(HandleAt(moved, projection, to_px));
    const ClipPlane& before = scene.cuts.planes[0];
    const ClipPlane& after = moved.cuts.planes[0];
    EXPECT_NE(before.normal_I, after.normal_I);
    EXPECT_EQ(scene.cuts.planes[1], moved.cuts.planes[1]);
    EXPECT_EQ(scene.cuts.crop, moved.cuts.crop);
    // The pivot is the disc's middle: on both planes.
    const Vec3& pivot_I = moved.pivots_I[0];
    EXPECT_NEAR(before.normal_I.dot(pivot_I), before.offset_voxels, 1e-6);
    EXPECT_NEAR(after.normal_I.dot(pivot_I), after.offset_voxels, 1e-6);
    ++turned;
  }
  EXPECT_GE(turned, 15);
}

TEST_F(CutHandles, OfAPlaneThatIsOffThereIsNone) {
  for (int trial = 0; trial < 100; ++trial) {
    CutScene scene = RandomScene();
    for (ClipPlane& plane : scene.cuts.planes) plane.on = false;
    const Projection projection(RandomCamera(), kViewSize);
    for (int n = 0; n < 200; ++n) {
      const auto handle = HandleAt(
          scene, projection, Vector2d(Random(0, kViewSize.width), Random(0, kViewSize.height)));
      EXPECT_TRUE(!handle || handle->kind == CutHandle::Kind::kFace);
    }
  }
}

// A turned plane is the same plane for points as for the normal, whatever the voxels' edges.
TEST_F(CutHandles, ADraggedPlaneMovesByAsManyMillimetresAsThePointer) {
  int moves = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const CutScene scene = RandomScene();
    const Projection projection(RandomCamera(), kViewSize);
    const ClipPlane& plane = scene.cuts.planes[1];
    const Vec3 covector_D = scene.X_DI.Inverse().linear.transpose() * plane.normal_I;
    const double above = plane.normal_I.dot(scene.pivots_I[1]) - plane.offset_voxels;
    const Vec3 on_plane_D =
        scene.X_DI.Apply(scene.pivots_I[1]) - above / covector_D.squaredNorm() * covector_D;
    const double way_mm = Random(-4, 4);
    const auto from = projection.PixelOf(on_plane_D);
    const auto to = projection.PixelOf(on_plane_D + way_mm * covector_D.normalized());
    ASSERT_TRUE(from && to);
    if ((*from - *to).norm() < 0.5) continue;
    const CutScene moved =
        CutDrag({CutHandle::Kind::kPlane, 1}, scene, projection, *from).At(projection, *to);
    EXPECT_NEAR(moved.cuts.planes[1].offset_voxels - plane.offset_voxels,
                way_mm * covector_D.norm(), 1e-6);
    ++moves;
  }
  EXPECT_GT(moves, 100);
}

// Of a projection: the way back is the way there.
TEST_F(CutHandles, APixelsRayMeetsThePoint) {
  for (int trial = 0; trial < 200; ++trial) {
    const Projection projection(RandomCamera(), kViewSize);
    const Vec3 p_D(Random(-50, 50), Random(-50, 50), Random(-50, 50));
    const auto at_px = projection.PixelOf(p_D);
    ASSERT_TRUE(at_px);
    const Ray ray = projection.RayThrough(*at_px);
    EXPECT_LT((p_D - ray.origin).cross(ray.direction).norm(), 1e-9 * 500);
    EXPECT_FALSE(projection.PixelOf(2.0 * projection.eye_D() - p_D));
  }
}

}  // namespace

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
