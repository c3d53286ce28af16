// Points of the surface that a hand can reach, spread over all of it.
//
// The voxels of leaves are looked at in an order that jumps about the volume, so that
// the first points found are a fair sample, of dust too. A point lies on an edge of the
// lattice, where the surface that is felt and the trilinear one are the same.
//
// Frame D (mm). Threads: pure; not real-time. The same surface gives the same points.
#pragma once

#include <cstdint>
#include <vector>

#include "common/isosurface/cell.h"
#include "server/device/haptic_device.h"
#include "server/haptics/haptic_surface.h"

namespace palpate {

// Reads the surface that the stylus feels at points of the device's space.
//
// The trilinear density: between lattice vertices the surface that is felt (H) differs
// from it by a fraction of a voxel.
//
// Frame D (mm). Threads: one; borrows the surface. Not real-time: the planner of the
// simulated hand uses it. Counts the cells that it reads, so that work can be bounded
// without a clock.
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

// Bounds of the work, as counts, so that the outcome does not depend on the machine.
struct GuideBudget {
  std::int64_t places = 1 << 20;  // of leaves: visits
  std::int64_t leaves = 1 << 17;  // whose voxels are read
  int points = 1024;              // the search ends with so many
  int strokes = 32;
  std::int64_t reads = 300'000;  // of cells, for all strokes and the ways between them
};

struct GuideCost {
  std::int64_t places = 0;
  std::int64_t leaves = 0;
  std::int64_t reads = 0;
};

struct SurfacePoint {
  Vec3 p_D_mm = Vec3::Zero();
  Vec3 normal_D = Vec3::UnitZ();  // unit, towards free space
};

// Whether a hand can be there, with a millimetre to spare.
bool IsWithinReach(const DeviceDescription& device, const Vec3& p_D_mm);

// Places in free space where a hand can wait, some millimetres off the surface: outside of the
// lattice, or else within it. Empty if the hand can reach none.
std::vector<Vec3> FindFreePlaces(const HapticSurface& surface, const DeviceDescription& device);

// Empty where the workspace holds no surface.
std::vector<SurfacePoint> FindTouchPoints(const HapticSurface& surface,
                                          const DeviceDescription& device,
                                          const GuideBudget& budget, GuideCost& cost);

}  // namespace palpate
