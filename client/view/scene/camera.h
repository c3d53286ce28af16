// The camera: it turns about a point that it looks at, y up as in the device's frame.
//
// Frames: D device (mm); V view (mm, x right, y up, z towards the viewer); pixels from
// the upper left corner, y down, pixel centres at halves.
// Threads: plain values.
#pragma once

#include "common/geometry/geometry.h"

namespace palpate::view {

using Mat4 = Eigen::Matrix4d;

struct ImageSize {
  int width = 0;
  int height = 0;
  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

struct Ray {
  Vec3 origin = Vec3::Zero();
  Vec3 direction = -Vec3::UnitZ();  // of length 1
};

// What is to be in view when the camera is reset.
struct Bounds {
  Vec3 min_mm = Vec3::Constant(-50.0);
  Vec3 max_mm = Vec3::Constant(50.0);
};

class Camera {
 public:
  static constexpr double kFieldOfView_deg = 35.0;  // of the image's shorter side

  // Looks at the middle of `bounds` from the front, slightly from above and the
  // right, far enough to see all of it in an image of any shape.
  void Reset(const Bounds& bounds);
  // Turns about the target; elevation stays within ±89°.
  void Orbit(double azimuth_deg, double elevation_deg);
  // Above 1 comes closer.
  void Zoom(double factor);
  // The target follows a drag of so many pixels.
  void Pan(double right_px, double down_px, const ImageSize& size);
  void LookAt(const Vec3& target_D);

  // For scripts: the whole view.
  void Set(const Vec3& target_D, double azimuth_deg, double elevation_deg, double distance_mm);

  const Vec3& target() const { return target_D_; }
  double azimuth_deg() const { return azimuth_deg_; }
  double elevation_deg() const { return elevation_deg_; }
  double distance_mm() const { return distance_mm_; }
  Vec3 Eye() const;  // D

  AffineMap X_VD() const;
  // OpenGL clip coordinates, depth in [-1, 1]; near and far planes follow `bounds` and
  // the target, so that what is near either is never cut.
  Mat4 ClipFromView(const ImageSize& size, const Bounds& bounds) const;
  Mat4 ClipFromD(const ImageSize& size, const Bounds& bounds) const;
  // Through the centre of a pixel, or any point of it. In D.
  Ray RayThrough(double x_px, double y_px, const ImageSize& size) const;

  friend bool operator==(const Camera&, const Camera&) = default;

 private:
  Vec3 target_D_ = Vec3::Zero();
  double azimuth_deg_ = 20.0;    // about y, 0 from +z
  double elevation_deg_ = 15.0;  // above the x-z plane
  double distance_mm_ = 300.0;
};

}  // namespace palpate::view
