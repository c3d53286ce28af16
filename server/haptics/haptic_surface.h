// What the stylus feels: a volume, an isovalue, and where the volume lies.
//
// Frames: I voxel index, D device (mm). Densities are normalised over the
// volume's range. Distances, projections and normals are taken in D, whatever
// spacing, shear or mirror the volume's transform has.
// Threads: plain values. Ownership: borrows the snapshot.
#pragma once

#include <cstdint>

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "server/volume/snapshot.h"

namespace palpate {

struct HapticSurface {
  const VolumeSnapshot* volume = nullptr;
  double isovalue = 0.5;  // τ, normalised
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  AffineMap X_DI;
  AffineMap X_ID;
  // Changes whenever anything but the isovalue does.
  std::uint64_t geometry_revision = 0;

  // Shortest edge of a voxel in D: the scale that tolerances refer to.
  double voxel_mm = 1.0;
};

inline HapticSurface MakeHapticSurface(const VolumeSnapshot& volume, const AffineMap& X_DI,
                                       double isovalue, DecompositionMethod method,
                                       std::uint64_t geometry_revision) {
  HapticSurface surface;
  surface.volume = &volume;
  surface.isovalue = isovalue;
  surface.method = method;
  surface.X_DI = X_DI;
  surface.X_ID = X_DI.Inverse();
  surface.geometry_revision = geometry_revision;
  surface.voxel_mm = X_DI.linear.colwise().norm().minCoeff();
  return surface;
}

}  // namespace palpate
