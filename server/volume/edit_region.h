// Where an edit acts: the checked shape, its weight at every voxel, and the box of
// voxels that it can reach.
//
// Frames: positions of voxels in I; the shape in W (mm) or I (voxels).
// Threads: pure; any. Errors: Error.
#pragma once

#include "server/volume/edit.h"

namespace palpate {

// Throws Error (kInvalidArgument) for an edit that makes no sense on `volume`
// whatever its region. The region is checked by EditedVoxels.
void CheckEdit(const VolumeSnapshot& volume, const VolumeEdit& edit);

// The voxels that the edit can reach, within the lattice; none where the shape is
// so small that it lies between them. kInvalidArgument for a region that misses the
// lattice, or a block that sticks out; kTooLarge.
std::optional<VoxelBox> EditedVoxels(const VolumeSnapshot& volume, const VolumeEdit& edit);

// Weights of a shape other than a block. Borrows the edit.
class EditWeights {
 public:
  EditWeights(const VolumeSnapshot& volume, const VolumeEdit& edit);

  // In [0, 1]. `voxel`: in I.
  double At(const Vec3& voxel) const { return OfDistance(Distance(PositionOf(voxel))); }

  enum class Reach { kNone, kSome, kAll };
  // Of the brick's voxels: all have weight 0, or all have weight 1, or neither is
  // sure.
  Reach Of(const Vec3i& brick) const;

 private:
  Vec3 PositionOf(const Vec3& voxel) const { return X_FI_.linear * voxel + X_FI_.translation; }
  // From the shape, negative within it; grows by at most the distance moved.
  double Distance(const Vec3& position) const;
  double OfDistance(double distance) const;

  const VolumeEdit& edit_;
  AffineMap X_FI_;  // index to the edit's frame
  double brick_radius_;
  Vec3 axis_ = Vec3::Zero();  // of a capsule: unit vector, and its length
  double length_ = 0.0;
};

}  // namespace palpate
