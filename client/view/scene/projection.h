// Where a point of space is in a picture, and the way back.
//
// Frames: D (mm); pixels from the upper left corner, y down, pixel centres at halves.
// Threads: plain values.
#pragma once

#include <optional>

#include "client/view/scene/camera.h"

namespace palpate::view {

class Projection {
 public:
  Projection(const Camera& camera, const ImageSize& size);

  // None: the point is beside or behind the eye.
  std::optional<Eigen::Vector2d> PixelOf(const Vec3& p_D) const;
  // The size of one pixel at a point, in mm; of points beside or behind the eye a very small one.
  double MmPerPixel(const Vec3& p_D) const;
  Ray RayThrough(const Eigen::Vector2d& at_px) const;
  const Vec3& eye_D() const { return eye_D_; }

 private:
  double DepthOf(const Vec3& p_D) const { return -X_VD_.Apply(p_D).z(); }

  Camera camera_;
  ImageSize size_;
  AffineMap X_VD_;
  Vec3 eye_D_;
  Eigen::Vector2d px_per_slope_;  // to the right and up, for one mm at a depth of one mm
};

}  // namespace palpate::view
