// Finds where an edit acts: the checked shape, its weight at every voxel, and the box of voxels
// that it can reach.
//
// Frames: positions of voxels in I; the shape in W (mm) or I (voxels).
// Threads: pure; any. Errors: Error.
#pragma once

#include <array>
#include <optional>

#include "server/volume/edit/edit.h"

namespace palpate {

// Throws Error (kInvalidArgument) for an edit that is invalid for `volume`, whatever its region.
// EditedVoxels checks the region.
void CheckEdit(const VolumeSnapshot& volume, const VolumeEdit& edit);

// Returns the voxels of the lattice that the edit can reach; none if the shape is so small that it
// lies between voxels. Throws kInvalidArgument for a region outside the lattice, or a block that
// reaches beyond it; kTooLarge for more than `most_voxels`.
std::optional<IndexBox> EditedVoxels(const VolumeSnapshot& volume, const VolumeEdit& edit,
                                     std::int64_t most_voxels = kMostEditedVoxels);

// One number for every voxel of a brick.
using BrickNumbers = std::array<double, kBrickVoxels>;

// Weights of a shape other than a block. Borrows the edit.
class EditWeights {
 public:
  EditWeights(const VolumeSnapshot& volume, const VolumeEdit& edit);

  // Computes the weights of a brick's voxels, each in [0, 1]. If all are 0, returns false and does
  // not set `weights`.
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
