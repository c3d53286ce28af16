// Reads the surface that the stylus feels at points of the device's space.
//
// The trilinear density: between lattice vertices the surface that is felt (H) differs
// from it by a fraction of a voxel.
//
// Frame D (mm). Threads: one; borrows the surface. Not real-time: the planner of the
// simulated hand uses it. Counts the cells that it reads, so that work can be bounded
// without a clock.
#pragma once

#include <cstdint>

#include "common/isosurface/cell.h"
#include "server/haptics/haptic_surface.h"

namespace palpate {

class SurfaceProbe {
 public:
  explicit SurfaceProbe(const HapticSurface& surface) : surface_(surface) {}

  // Felt density above the isovalue: positive in material.
  double At(const Vec3& p_D_mm);
  bool IsMaterial(const Vec3& p_D_mm) { return At(p_D_mm) > 0.0; }
  // Of the density, per mm; over a voxel and a half, so that it is smooth.
  Vec3 GradientAt(const Vec3& p_D_mm);
  // Unit, towards free space; zero where the density is flat.
  Vec3 NormalAt(const Vec3& p_D_mm);
  // Moves the point along its line to the surface. False, and the point stays, where that is
  // farther than `reach_mm`.
  bool Project(Vec3& p_D_mm, const Vec3& normal_D, double reach_mm);

  // Within the lattice and its padding: beyond, all has the density of outside.
  bool IsInLattice(const Vec3& p_D_mm) const;

  const HapticSurface& surface() const { return surface_; }
  std::int64_t reads() const { return reads_; }

 private:
  double AtIndex(const Vec3& p_I);

  const HapticSurface& surface_;
  Vec3i cell_ = Vec3i::Constant(-1000);  // whose densities those are
  CellDensities densities_{};
  std::int64_t reads_ = 0;
};

}  // namespace palpate
