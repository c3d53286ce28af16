// The camera, and where it shows points. It turns about the point that it looks at, and keeps
// something upright: the device, or the patient.
//
// Frames: D device (mm); U what is upright (x right, y up, z to the front); V view (mm, x right,
// y up, z towards the viewer); pixels from the upper left corner, y down, pixel centres at halves.
// Threads: plain values.
#pragma once

#include <optional>

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

// The region that a reset brings into view.
struct Bounds {
  Vec3 min_mm = Vec3::Constant(-50.0);
  Vec3 max_mm = Vec3::Constant(50.0);
};
// Around the image of a box.
Bounds BoundsOf(const AffineMap& map, const Vec3& min, const Vec3& max);

class Camera {
 public:
  static constexpr double kFieldOfView_deg = 35.0;  // of the image's shorter side

  // Sees three quarters of `bounds`: from the front, from the right and from above. D is upright.
  void Reset(const Bounds& bounds);
  // Sees all of `bounds` from its direction, in an image of any shape, from as near as possible.
  void Fit(const Bounds& bounds);
  // Keeps this frame upright: R_DU is a rotation. The angles stay, so the view turns.
  void SetUpright(const Mat3& R_DU) { R_DU_ = R_DU; }
  const Mat3& upright() const { return R_DU_; }
  // Turns about the target. The elevation stays within ±89°.
  void Orbit(double azimuth_deg, double elevation_deg);
  // A factor above 1 moves closer.
  void Zoom(double factor);
  // Moves the target by a drag of this many pixels.
  void Pan(double right_px, double down_px, const ImageSize& size);
  void LookAt(const Vec3& target_D);

  // Sets the whole view, for scripts.
  void Set(const Vec3& target_D, double azimuth_deg, double elevation_deg, double distance_mm);

  const Vec3& target() const { return target_D_; }
  double azimuth_deg() const { return azimuth_deg_; }
  double elevation_deg() const { return elevation_deg_; }
  double distance_mm() const { return distance_mm_; }
  Vec3 Eye() const;  // D

  AffineMap X_VD() const;
  // OpenGL clip coordinates, depth in [-1, 1]. The near and far planes depend on `bounds` and the
  // target, so that nothing near them is cut.
  Mat4 ClipFromD(const ImageSize& size, const Bounds& bounds) const;
  // The ray through a point of the image, in D.
  Ray RayThrough(double x_px, double y_px, const ImageSize& size) const;
  // The length in D that a pixel shows, across the view at the target.
  double MmPerPixel(const ImageSize& size) const;

  friend bool operator==(const Camera&, const Camera&) = default;

 private:
  Vec3 target_D_ = Vec3::Zero();
  Mat3 R_DU_ = Mat3::Identity();
  double azimuth_deg_ = 30.0;    // about U's y, 0 from +z
  double elevation_deg_ = 20.0;  // above U's x-z plane
  double distance_mm_ = 300.0;
};

// Where points are in a picture of this camera, and the way back.
class Projection {
 public:
  Projection(const Camera& camera, const ImageSize& size);

  // None: the point is beside or behind the eye.
  std::optional<Eigen::Vector2d> PixelOf(const Vec3& p_D) const;
  // The size of one pixel at a point, in mm; of points beside or behind the eye a very small one.
  double MmPerPixel(const Vec3& p_D) const;
  Ray RayThrough(const Eigen::Vector2d& at_px) const;
  const Vec3& eye_D() const { return eye_D_; }
  // The columns point right, up and to the viewer.
  Mat3 R_DV() const { return X_VD_.linear.transpose(); }

 private:
  Camera camera_;
  ImageSize size_;
  AffineMap X_VD_;
  Vec3 eye_D_;
  Eigen::Vector2d px_per_slope_;  // to the right and up, for one mm at a depth of one mm
};

}  // namespace palpate::view
