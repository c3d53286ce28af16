// Maps a slice of the lattice to a picture.
//
// The whole padded lattice is shown, one voxel beyond the outermost voxels on each side, so that
// isolines close. Voxels have their physical shape. The rest of the picture is empty.
//
// Frames: I (voxels); pixels from the upper left corner, y down, pixel centres at halves.
// Threads: plain values.
#pragma once

#include <optional>

#include "client/view/scene/camera.h"
#include "client/view/scene/patient_axes.h"
#include "client/view/scene/view_options.h"

namespace palpate::view {

inline const Rgb kIsolineColor{1.0f, 0.62f, 0.15f};  // of the surface; the veil has its own
inline const Rgb kEmptySliceColor{0.06f, 0.068f, 0.084f};

class SliceView {
 public:
  // `axes`: of I. `voxel_mm`: edges of a voxel, above 0.
  SliceView(const SliceAxes& axes, const Vec3i& lattice_size, const Vec3& voxel_mm,
            const ImageSize& size);

  // Pixels per voxel to the right and down. Negative if the axis of I runs the other way.
  const Eigen::Vector2d& px_per_voxel() const { return px_per_voxel_; }

  // Returns the point of the slice at `position_voxels` that appears at a point of the picture,
  // also beyond the lattice.
  Vec3 PointAt(const Eigen::Vector2d& point_px, double position_voxels) const;
  Eigen::Vector2d PixelOf(const Vec3& p_I) const;
  // True within the part of the picture that shows the lattice.
  bool Shows(const Eigen::Vector2d& point_px) const;

 private:
  SliceAxes axes_;
  Eigen::Vector2d px_per_voxel_;
  Eigen::Vector2d origin_px_;  // of voxel (0, 0)
  Eigen::Vector2d min_px_;     // corners of the padded lattice
  Eigen::Vector2d max_px_;
};

// Edges of a voxel in mm of D, or edges of the same shape. Edges of a cube if the volume's place is
// not known.
Vec3 VoxelEdges(const std::optional<AffineMap>& X_DI);

}  // namespace palpate::view
