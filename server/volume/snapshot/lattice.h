// The lattice whose cells H is made of: every cell of a volume's voxels, cut into refinement³
// sub-cells (sub_cell.h). Nothing is stored: values are interpolated when they are read.
//
// H then comes nearer to V like 1 / refinement², and has the same topology. In a sub-cell, H and V
// are equivalent as in any cell; sub-cells that share a face have the same four values there, bit
// for bit. The resolved values of the voxels are interpolated, not resolved anew: so H is that of
// one function F for every refinement, and ties give no sub-cell a saddle that F does not have.
//
// Frames: L index of the lattice, I voxel index. Index -1 is the same in both, so the padding stays
// one voxel wide: p_I = (p_L + 1) / refinement - 1. With refinement 1 both are the same.
// Threads: any, at once. Real-time: wait-free, no allocation. Ownership: borrows the volume.
#pragma once

#include "common/isosurface/sub_cell.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

class Lattice {
 public:
  Lattice() = default;
  // Also converts a volume to the lattice of its voxels.
  Lattice(const VolumeSnapshot& volume, int refinement = 1)
      : volume_(&volume),
        refinement_(refinement),
        size_(refinement * (volume.size() + Vec3i::Ones()) - Vec3i::Ones()) {}

  const VolumeSnapshot& volume() const { return *volume_; }
  int refinement() const { return refinement_; }
  // Vertices have index coordinates in [0, size), cells in [-1, size).
  const Vec3i& size() const { return size_; }
  bool HasCell(const Vec3i& cell) const noexcept {
    return (cell.array() >= -1).all() && (cell.array() < size_.array()).all();
  }

  // The cell of the voxels that a cell lies in, and where it lies there.
  struct Part {
    Vec3i voxel_cell, sub;
  };
  Part PartOf(const Vec3i& cell) const noexcept {
    Part part;
    for (int axis = 0; axis < 3; ++axis) {
      // Not negative: also a cell beside the padding can be asked for.
      const auto from_padding = static_cast<std::uint32_t>(cell[axis] + 1 + refinement_);
      // Without a division, which takes longer than the rest.
      const std::uint32_t quotient =
          refinement_ == 3 ? from_padding / 3 : from_padding >> (refinement_ / 2);
      part.voxel_cell[axis] = static_cast<int>(quotient) - 2;
      part.sub[axis] = static_cast<int>(from_padding - quotient * refinement_);
    }
    return part;
  }
  // From `local` coordinates in a cell to those in its cell of the voxels.
  Vec3 InVoxelCell(const Vec3i& cell, const Vec3& local) const noexcept {
    if (refinement_ == 1) return local;
    return (PartOf(cell).sub.cast<double>() + local) / refinement_;
  }

  // Densities of a cell with ties resolved. They define H.
  CellDensities ResolvedCell(const Vec3i& cell) const noexcept;
  // As VolumeSnapshot::CellRevision.
  std::uint64_t CellRevision(const Vec3i& cell) const noexcept {
    return volume_->CellRevision(refinement_ == 1 ? cell : PartOf(cell).voxel_cell);
  }

  Vec3 FromVoxels(const Vec3& p_I) const {
    if (refinement_ == 1) return p_I;
    return (p_I + Vec3::Ones()) * refinement_ - Vec3::Ones();
  }
  Vec3 ToVoxels(const Vec3& p_L) const {
    if (refinement_ == 1) return p_L;
    return (p_L + Vec3::Ones()) / refinement_ - Vec3::Ones();
  }
  // X_DL of X_DI; D is any frame.
  AffineMap OnLattice(const AffineMap& X_DI) const {
    if (refinement_ == 1) return X_DI;
    return {X_DI.linear / refinement_, X_DI.Apply(ToVoxels(Vec3::Zero()))};
  }

 private:
  const VolumeSnapshot* volume_ = nullptr;
  int refinement_ = 1;
  Vec3i size_ = Vec3i::Zero();
};

}  // namespace palpate
