// Where an edit acts: the checked shape, its weight at every voxel, and the box of
// voxels that it can reach.
//
// Frames: positions of voxels in I; the shape in W (mm) or I (voxels).
// Threads: pure; any. Errors: Error.
#pragma once

#include <array>
#include <optional>

#include "server/volume/edit.h"

namespace palpate {

// Throws Error (kInvalidArgument) for an edit that makes no sense on `volume`
// whatever its region. The region is checked by EditedVoxels.
void CheckEdit(const VolumeSnapshot& volume, const VolumeEdit& edit);

// The voxels that the edit can reach, within the lattice; none where the shape is
// so small that it lies between them. kInvalidArgument for a region that misses the
// lattice, or a block that sticks out; kTooLarge for more than `most_voxels`.
std::optional<VoxelBox> EditedVoxels(const VolumeSnapshot& volume, const VolumeEdit& edit,
                                     std::int64_t most_voxels = kMostEditedVoxels);

// One number for every voxel of a brick.
using BrickNumbers = std::array<double, kBrickVoxels>;

// Weights of a shape other than a block. Borrows the edit.
class EditWeights {
 public:
  EditWeights(const VolumeSnapshot& volume, const VolumeEdit& edit);

  // Of the voxels of a brick, each in [0, 1]. False: all are 0, and none is set.
  bool Of(const Vec3i& brick, BrickNumbers& weights) const;

 private:
  template <class Distance>
  bool Fill(const Vec3i& brick, const Distance& distance, BrickNumbers& weights) const;
  double OfDistance(double distance) const;

  const VolumeEdit& edit_;
  AffineMap X_FI_;  // index to the edit's frame
  double brick_radius_;
};

}  // namespace palpate
