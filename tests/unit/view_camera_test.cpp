// The camera: rays agree with the matrices, drags with what is dragged.
#include "client/view/drawing/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace palpate::view {
namespace {

// Where a point of D appears, in pixels; z: OpenGL's depth in [-1, 1] where not cut.
Vec3 Appears(const Camera& camera, const Vec3& p_D, const ImageSize& size, const Bounds& bounds) {
  const Eigen::Vector4d clip = camera.ClipFromD(size, bounds) * p_D.homogeneous();
  EXPECT_GT(clip.w(), 0.0);
  const Vec3 p = clip.hnormalized();
  return {0.5 * (p.x() + 1.0) * size.width, 0.5 * (1.0 - p.y()) * size.height, p.z()};
}

class Dice {
 public:
  double Between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vec3 Point(double reach) {
    return {Between(-reach, reach), Between(-reach, reach), Between(-reach, reach)};
  }
  ImageSize Size() {
    return {static_cast<int>(Between(1, 3000)), static_cast<int>(Between(1, 3000))};
  }
  Camera AnyCamera() {
    Camera camera;
    camera.Set(Point(100), Between(-720, 720), Between(-120, 120), Between(1, 1000));
    return camera;
  }
  Mat3 AnyTurn() {
    return Eigen::AngleAxisd(Between(0, 6), Point(1).normalized()).toRotationMatrix();
  }

 private:
  std::mt19937 random_{11};
};

std::vector<Vec3> Corners(const Bounds& bounds) {
  std::vector<Vec3> corners;
  for (int n = 0; n < 8; ++n) {
    const Eigen::Array3d share(n & 1, n >> 1 & 1, n >> 2 & 1);
    corners.push_back(bounds.min_mm + (share * (bounds.max_mm - bounds.min_mm).array()).matrix());
  }
  return corners;
}

TEST(Camera, ThePixelOfAPointIsThatOfItsRay) {
  Dice dice;
  for (int n = 0; n < 10000; ++n) {
    Camera camera = dice.AnyCamera();
    camera.SetUpright(dice.AnyTurn());
    const ImageSize size = dice.Size();
    const double x = dice.Between(0, size.width), y = dice.Between(0, size.height);
    const Ray ray = camera.RayThrough(x, y, size);
    const Projection projection(camera, size);
    const auto px = projection.PixelOf(ray.origin + dice.Between(1, 500) * ray.direction);
    ASSERT_TRUE(px);
    EXPECT_NEAR(px->x(), x, 1e-6);
    EXPECT_NEAR(px->y(), y, 1e-6);
    EXPECT_FALSE(projection.PixelOf(ray.origin - 10.0 * ray.direction));
    // Beside the target by as many pixels.
    const Vec3 right_D = camera.X_VD().linear.row(0);
    const auto middle = projection.PixelOf(camera.target());
    const auto beside = projection.PixelOf(camera.target() + camera.MmPerPixel(size) * right_D);
    EXPECT_NEAR(beside->x() - middle->x(), 1.0, 1e-6);
  }
}

TEST(Camera, APointOnARayAppearsAtItsPixel) {
  Dice dice;
  for (int n = 0; n < 10000; ++n) {
    const Camera camera = dice.AnyCamera();
    const ImageSize size = dice.Size();
    const double x = dice.Between(0, size.width), y = dice.Between(0, size.height);
    const Ray ray = camera.RayThrough(x, y, size);
    EXPECT_NEAR(ray.direction.norm(), 1.0, 1e-12);
    EXPECT_EQ(ray.origin, camera.Eye());
    const Vec3 p = ray.origin + dice.Between(0.1, 2000) * ray.direction;
    const Vec3 seen = Appears(camera, p, size, Bounds());
    ASSERT_NEAR(seen.x(), x, 1e-6);
    ASSERT_NEAR(seen.y(), y, 1e-6);
  }
}

TEST(Camera, TheTargetIsInTheMiddleAndUpIsUp) {
  Dice dice;
  for (int n = 0; n < 1000; ++n) {
    const Camera camera = dice.AnyCamera();
    const ImageSize size = dice.Size();
    const Vec3 seen = Appears(camera, camera.target(), size, Bounds());
    ASSERT_NEAR(seen.x(), 0.5 * size.width, 1e-6);
    ASSERT_NEAR(seen.y(), 0.5 * size.height, 1e-6);
    ASSERT_NEAR((camera.Eye() - camera.target()).norm(), camera.distance_mm(), 1e-9);
    const Vec3 above = camera.target() + 0.1 * camera.distance_mm() * Vec3::UnitY();
    const Vec3 top = Appears(camera, above, size, Bounds());
    ASSERT_NEAR(top.x(), seen.x(), 1e-6);
    ASSERT_LT(top.y(), seen.y());
    const AffineMap X_VD = camera.X_VD();
    ASSERT_NEAR(X_VD.linear.determinant(), 1.0, 1e-12);
    ASSERT_NEAR(X_VD.Apply(camera.Eye()).norm(), 0.0, 1e-9);
  }
  Camera front;
  front.Set(Vec3::Zero(), 0, 0, 10);
  EXPECT_NEAR((front.Eye() - Vec3(0, 0, 10)).norm(), 0.0, 1e-12);
  front.Orbit(90, 0);  // to the right
  EXPECT_NEAR((front.Eye() - Vec3(10, 0, 0)).norm(), 0.0, 1e-12);
  front.Orbit(0, 500);
  EXPECT_EQ(front.elevation_deg(), 89.0);
  EXPECT_GT(front.Eye().y(), 9.99);
}

TEST(Camera, WhatIsDraggedFollowsThePointer) {
  Dice dice;
  for (int n = 0; n < 1000; ++n) {
    Camera camera = dice.AnyCamera();
    const ImageSize size = {200 + static_cast<int>(dice.Between(0, 2000)),
                            200 + static_cast<int>(dice.Between(0, 2000))};
    const Vec3 held = camera.target();
    const double right = dice.Between(-90, 90), down = dice.Between(-90, 90);
    camera.Pan(right, down, size);
    const Vec3 seen = Appears(camera, held, size, Bounds());
    ASSERT_NEAR(seen.x(), 0.5 * size.width + right, 1e-6);
    ASSERT_NEAR(seen.y(), 0.5 * size.height + down, 1e-6);
  }
}

TEST(Camera, ZoomComesCloserAndStaysSane) {
  Camera camera;
  camera.Set(Vec3(1, 2, 3), 10, 20, 100);
  const Vec3 eye = camera.Eye();
  camera.Zoom(2.0);
  EXPECT_DOUBLE_EQ(camera.distance_mm(), 50.0);
  EXPECT_NEAR((camera.Eye() - 0.5 * (eye + camera.target())).norm(), 0.0, 1e-9);
  for (const double factor : {0.0, -1.0, std::nan("")}) camera.Zoom(factor);
  EXPECT_DOUBLE_EQ(camera.distance_mm(), 50.0);
  for (int n = 0; n < 10000; ++n) camera.Zoom(1.5);
  EXPECT_GT(camera.distance_mm(), 0.0);
  EXPECT_TRUE(camera.ClipFromD({800, 600}, Bounds()).allFinite());
  for (int n = 0; n < 10000; ++n) camera.Zoom(0.5);
  EXPECT_TRUE(std::isfinite(camera.distance_mm()));
  EXPECT_TRUE(camera.ClipFromD({0, 0}, Bounds()).allFinite());
  EXPECT_TRUE(camera.ClipFromD({8, 8}, {camera.target(), camera.target()}).allFinite());
}

TEST(Camera, AResetShowsAllOfItInAnImageOfAnyShape) {
  Dice dice;
  for (int n = 0; n < 2000; ++n) {
    Bounds bounds;
    const Vec3 a = dice.Point(200), b = dice.Point(200);
    bounds.min_mm = a.cwiseMin(b);
    bounds.max_mm = a.cwiseMax(b);
    if (n % 7 == 0) bounds.max_mm.x() = bounds.min_mm.x();
    Camera camera;
    camera.Reset(bounds);
    const ImageSize size = n % 5 == 0 ? ImageSize{50, 3000} : dice.Size();
    double widest = 0.0;
    for (const Vec3& corner : Corners(bounds)) {
      const Vec3 seen = Appears(camera, corner, size, bounds);
      ASSERT_GE(seen.x(), 0.0);
      ASSERT_LE(seen.x(), size.width);
      ASSERT_GE(seen.y(), 0.0);
      ASSERT_LE(seen.y(), size.height);
      ASSERT_LT(std::abs(seen.z()), 1.0);
      const Vec3 from_middle = seen - Vec3(0.5 * size.width, 0.5 * size.height, seen.z());
      widest = std::max(widest, from_middle.norm() / std::min(size.width, size.height));
    }
    ASSERT_GT(widest, 0.15);  // and not from the moon
  }
}

// The old distance, to a sphere around the bounds, left a quarter of the picture to a cube.
TEST(Camera, FitTouchesTheEdgeOfTheImage) {
  Dice dice;
  for (int n = 0; n < 2000; ++n) {
    const Vec3 a = dice.Point(200), b = dice.Point(200);
    const Bounds bounds{a.cwiseMin(b), a.cwiseMax(b)};
    Camera camera = dice.AnyCamera();
    camera.SetUpright(dice.AnyTurn());
    camera.Fit(bounds);
    const ImageSize size = {600, 600};
    double widest_px = 0.0;
    for (const Vec3& corner : Corners(bounds)) {
      const Vec3 seen = Appears(camera, corner, size, bounds);
      widest_px = std::max({widest_px, std::abs(seen.x() - 300.0), std::abs(seen.y() - 300.0)});
    }
    ASSERT_LE(widest_px, 300.0);
    ASSERT_GT(widest_px, 0.9 * 300.0);
  }
}

TEST(Camera, WhatIsUprightStaysUprightWhileTheCameraTurns) {
  Dice dice;
  for (int n = 0; n < 1000; ++n) {
    Camera camera = dice.AnyCamera();
    const Mat3 R_DU = dice.AnyTurn();
    camera.SetUpright(R_DU);
    camera.Orbit(dice.Between(-720, 720), dice.Between(-120, 120));
    const ImageSize size = dice.Size();
    const Vec3 above = camera.target() + 0.1 * camera.distance_mm() * R_DU.col(1);
    const Vec3 top = Appears(camera, above, size, Bounds());
    ASSERT_NEAR(top.x(), 0.5 * size.width, 1e-6);
    ASSERT_LT(top.y(), 0.5 * size.height);
    ASSERT_NEAR((camera.Eye() - camera.target()).norm(), camera.distance_mm(), 1e-9);
  }
}

// Whatever the camera does: what is in front of it, around bounds and target, is between
// near and far plane.
TEST(Camera, NothingNearTheVolumeOrTheTargetIsCut) {
  Dice dice;
  int seen_points = 0;
  for (int n = 0; n < 2000; ++n) {
    const Camera camera = dice.AnyCamera();
    Bounds bounds{dice.Point(50) - Vec3::Constant(60), dice.Point(50) + Vec3::Constant(60)};
    std::vector<Vec3> points = Corners(bounds);
    points.push_back(camera.target());
    points.push_back(camera.target() + 5.0 * dice.Point(1));
    for (const Vec3& p : points) {
      const double depth = -camera.X_VD().Apply(p).z();
      if (depth < 0.02 * camera.distance_mm()) continue;
      ++seen_points;
      ASSERT_LT(std::abs(Appears(camera, p, {800, 600}, bounds).z()), 1.0);
    }
  }
  EXPECT_GT(seen_points, 10000);
}

}  // namespace
}  // namespace palpate::view
