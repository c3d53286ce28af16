// Maps a slice of the lattice to a picture.
//
// The whole padded lattice is shown, one voxel beyond the outermost voxels on each side, so that
// isolines close. Voxels have their physical shape. The rest of the picture is empty.
//
// Frames: I (voxels); pixels from the upper left corner, y down, pixel centres at halves.
// Threads: plain values.
#pragma once

#include <optional>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/view_options.h"

namespace palpate::view {

inline const Rgb kIsolineColor{1.0f, 0.62f, 0.15f};  // of the surface; the veil has its own
inline const Rgb kEmptySliceColor{0.06f, 0.068f, 0.084f};

// The part of a slice that its picture shows. It does not depend on the picture's size or sides.
struct SliceZoom {
  static constexpr double kMost = 100.0;

  double factor = 1.0;  // 1: all of the slice, from there to kMost
  // What is at the picture's middle, from the lattice's middle: along `right` and `down` axes of I.
  Eigen::Vector2d middle_voxels = Eigen::Vector2d::Zero();
  friend bool operator==(const SliceZoom&, const SliceZoom&) = default;
};

class SliceView {
 public:
  // `axes`: of I. `voxel_mm`: edges of a voxel, above 0.
  SliceView(const SliceAxes& axes, const Vec3i& lattice_size, const Vec3& voxel_mm,
            const ImageSize& size, const SliceZoom& zoom = {});

  // Pixels per voxel to the right and down. Negative if the axis of I runs the other way.
  const Eigen::Vector2d& px_per_voxel() const { return px_per_voxel_; }

  // Returns the point of the slice at `position_voxels` that appears at a point of the picture,
  // also beyond the lattice.
  Vec3 PointAt(const Eigen::Vector2d& point_px, double position_voxels) const;
  Eigen::Vector2d PixelOf(const Vec3& p_I) const;
  // What to show so that the picture is `factor` times as large, and the point under the pointer
  // stays there. The whole slice is always in the middle.
  SliceZoom ZoomedAt(const Eigen::Vector2d& point_px, double factor) const;
  // What to show so that the picture moves by this drag. The picture's middle stays on the lattice.
  SliceZoom MovedBy(const Eigen::Vector2d& drag_px) const;

  // True within the part of the picture that shows the lattice.
  bool Shows(const Eigen::Vector2d& point_px) const;

 private:
  SliceZoom ShowAtMiddle(double factor, const Eigen::Vector2d& middle_voxels) const;

  SliceAxes axes_;
  SliceZoom zoom_;
  Eigen::Vector2d lattice_voxels_;  // along right and down
  Eigen::Vector2d picture_px_;
  Eigen::Vector2d px_per_voxel_;
  Eigen::Vector2d origin_px_;  // of voxel (0, 0)
  Eigen::Vector2d min_px_;     // corners of the padded lattice
  Eigen::Vector2d max_px_;
};

// Edges of a voxel in mm of D, or edges of the same shape. Edges of a cube if the volume's place is
// not known.
Vec3 VoxelEdges(const std::optional<AffineMap>& X_DI);

}  // namespace palpate::view
