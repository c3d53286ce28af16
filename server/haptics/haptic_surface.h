// The surface that the stylus feels: a volume, an isovalue, the side from which it is felt, and the
// volume's place.
//
// Densities are normalised over the volume's range. To feel H from the side above τ, densities and
// isovalue change their sign; these are the "felt" values. On either side, material lies above the
// felt isovalue, and H is the same. The padding keeps its density. The space beyond the padding
// belongs to the side below τ; around a level set, it belongs to the side above τ.
//
// Frames: I voxel index, L index of the lattice that H is made of (lattice.h), D device (mm).
// Distances, projections and normals are taken in D, whatever spacing, shear or mirror the volume's
// transform has.
// Threads: plain values. Ownership: borrows the snapshot.
#pragma once

#include <cstdint>

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"
#include "server/volume/lattice.h"

namespace palpate {

struct HapticSurface {
  const VolumeSnapshot* volume = nullptr;
  Lattice lattice;        // of `volume`
  double isovalue = 0.5;  // τ, normalised and felt
  FreeSide free_side = FreeSide::kBelow;
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  AffineMap X_DI, X_ID;
  AffineMap X_DL, X_LD;
  // Changes whenever anything changes except the isovalue, the side, the refinement and voxels. The
  // volume's revisions say which voxels changed.
  std::uint64_t geometry_revision = 0;

  // Shortest edge of a voxel in D. Tolerances are relative to it.
  double voxel_mm = 1.0;
  double longest_voxel_mm = 1.0;

  double sign() const { return free_side == FreeSide::kBelow ? 1.0 : -1.0; }
  // The felt density of a voxel, ties resolved.
  double ResolvedVertex(const Vec3i& voxel) const noexcept {
    return sign() * volume->ResolvedVertex(voxel);
  }
  // Converts densities to felt ones, and back.
  CellDensities Felt(CellDensities densities) const noexcept {
    if (free_side == FreeSide::kBelow) return densities;
    for (double& density : densities) density = -density;
    return densities;
  }
  // The felt density beyond the padded lattice.
  double DensityOutside() const {
    if (volume->metadata().is_level_set) return sign() * volume->BackgroundDensity();
    return IsFreeOutside() ? 0.0 : 1.0;
  }
  bool IsFreeOutside() const {
    return (free_side == FreeSide::kBelow) != volume->metadata().is_level_set;
  }
  // The same H from its other side.
  HapticSurface Flipped() const {
    HapticSurface other = *this;
    other.free_side = free_side == FreeSide::kBelow ? FreeSide::kAbove : FreeSide::kBelow;
    other.isovalue = -isovalue;
    return other;
  }
  // The same volume with H made of cells of another size.
  void Refine(int refinement) noexcept {
    lattice = Lattice(*volume, refinement);
    X_DL = lattice.OnLattice(X_DI);
    X_LD = {refinement * X_ID.linear, lattice.FromVoxels(X_ID.translation)};
  }
};

inline HapticSurface MakeHapticSurface(const VolumeSnapshot& volume, const AffineMap& X_DI,
                                       double isovalue, DecompositionMethod method,
                                       std::uint64_t geometry_revision,
                                       FreeSide free_side = FreeSide::kBelow, int refinement = 1) {
  HapticSurface surface;
  surface.volume = &volume;
  surface.free_side = free_side;
  surface.isovalue = surface.sign() * isovalue;
  surface.method = method;
  surface.X_DI = X_DI;
  surface.X_ID = X_DI.Inverse();
  surface.Refine(refinement);
  surface.geometry_revision = geometry_revision;
  surface.voxel_mm = X_DI.linear.colwise().norm().minCoeff();
  surface.longest_voxel_mm = X_DI.linear.colwise().norm().maxCoeff();
  return surface;
}

}  // namespace palpate
