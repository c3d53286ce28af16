// How a slice of the lattice lies in a picture.
//
// Orientation, as image viewers have it: across z, x to the right and y down; across
// y, x to the right and z up; across x, y to the right and z up. The whole padded
// lattice is shown, one voxel beyond the outermost on each side, so that isolines
// close; voxels have their physical shape, and what is left of the picture is empty.
//
// Frames: I (voxels); pixels from the upper left corner, y down, pixel centres at
// halves.
// Threads: plain values.
#pragma once

#include <optional>

#include "client/view/scene/camera.h"
#include "client/view/scene/view_options.h"

namespace palpate::view {

inline const Rgb kIsolineColor{1.0f, 0.62f, 0.15f};  // of the surface; the veil has its own
inline const Rgb kEmptySliceColor{0.06f, 0.068f, 0.084f};

class SliceView {
 public:
  // `axis`: 0 x, 1 y, 2 z. `voxel_mm`: edges of a voxel, above 0.
  SliceView(int axis, const Vec3i& lattice_size, const Vec3& voxel_mm, const ImageSize& size);

  int axis() const { return axis_; }
  int right_axis() const { return right_axis_; }  // of I, along a row of pixels
  int down_axis() const { return down_axis_; }    // of I, along a column
  // Pixels for one voxel along them; the second is negative where the axis points up.
  const Eigen::Vector2d& px_per_voxel() const { return px_per_voxel_; }

  // The point of the slice at `position_voxels` that is seen at a point of the
  // picture; beyond the lattice too.
  Vec3 PointAt(const Eigen::Vector2d& point_px, double position_voxels) const;
  Eigen::Vector2d PixelOf(const Vec3& p_I) const;
  // Within the part of the picture that shows the lattice.
  bool Shows(const Eigen::Vector2d& point_px) const;

 private:
  int axis_;
  int right_axis_;
  int down_axis_;
  Eigen::Vector2d px_per_voxel_;
  Eigen::Vector2d origin_px_;  // of voxel (0, 0)
  Eigen::Vector2d min_px_;     // corners of the padded lattice
  Eigen::Vector2d max_px_;
};

// Edges of a voxel in mm of D, or of the same shape; those of a cube where it is not
// known where the volume lies.
Vec3 VoxelEdges(const std::optional<AffineMap>& X_DI);

}  // namespace palpate::view
