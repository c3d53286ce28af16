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

#include "server/device/haptic_device.h"
#include "server/haptics/haptic_surface.h"

namespace palpate {

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
