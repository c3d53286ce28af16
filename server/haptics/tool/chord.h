// Straight ways of single points through the tetrahedra of a volume, and the planes of H around
// them.
//
// A point here is a position, without a combinatorial place (place.h): the rounded poses of a rigid
// tool cannot put several points on planes exactly. So a point keeps kDensityMargin of density away
// from τ, which is more than what any rounding of the same position changes.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation; bounded by the work counted.
#pragma once

#include <optional>

#include "server/haptics/cell_cache.h"

namespace palpate {

// Positions within a metre of the origin; steeper than 10 of the range in a millimetre, nothing is.
inline constexpr double kDensityMargin = 1e-11;

inline double DensityBound(const HapticSurface& surface) {
  return surface.isovalue - kDensityMargin;
}

// H in a tetrahedron, extended to a plane.
struct SurfacePlane {
  Vec3 normal_D;     // towards free space, unit
  double offset_mm;  // normal_D · p of all p of the plane
  double slope;      // of the density, per mm

  double Gap(const Vec3& p_mm) const { return normal_D.dot(p_mm) - offset_mm; }
  // The density of the tetrahedron's gradient there, less the bound.
  double Excess(const Vec3& p_mm) const { return -slope * Gap(p_mm); }

  bool operator==(const SurfacePlane&) const = default;
};

struct ChordHit {
  double share = 1.0;                 // of the chord, before which it is free
  std::optional<SurfacePlane> plane;  // none: of no single tetrahedron
};

// The first point where a chord that begins in free space leaves it. `work` counts the cells and
// tetrahedra that were looked at.
std::optional<ChordHit> FirstHit(const HapticSurface& surface, const Vec3& from_mm,
                                 const Vec3& to_mm, ToolCellCache& cache, int& work) noexcept;

// What is around a point.
struct Surroundings {
  static constexpr int kMost = 48;

  // The density at the point, less the bound; minus infinity in a free cell without planes near.
  double excess = 0.0;
  // Those of the tetrahedra within reach that H may cross, or that are all beyond it.
  std::array<SurfacePlane, kMost> plane;
  int count = 0;
};

// The most work of FirstHit for so long a chord, and of Look.
int MostChordWork(const HapticSurface& surface, double way_mm) noexcept;
int MostLookWork(const HapticSurface& surface, double reach_mm) noexcept;

void Look(const HapticSurface& surface, const Vec3& p_mm, double reach_mm, ToolCellCache& cache,
          Surroundings& around, int& work) noexcept;

}  // namespace palpate
