// The forces of a haptic update, once the proxy is placed, and what they need to know of the
// surface: its smooth normal, and its nearest point.
//
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include <optional>

#include "server/haptics/cell_cache.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"

namespace palpate {

// Finds the point of H that is nearest to a point in free space.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation; bounded by the cells
// within reach, (2 kMaxNearestVoxels + 3)³.

// The farthest search, in distances between the closest lattice planes.
inline constexpr int kMaxNearestVoxels = 4;

inline double MaxNearestMm(const HapticSurface& surface) {
  return kMaxNearestVoxels / surface.X_ID.linear.rowwise().norm().maxCoeff();
}

// Returns nothing if H is farther away than `reach_mm` or MaxNearestMm().
std::optional<Vec3> NearestPointOnSurface(const HapticSurface& surface, const Vec3& p_D,
                                          double reach_mm, CellCache& cache) noexcept;

// The greatest angle between the smooth normal and the normal of H. Where the density does not look
// like a surface, H decides.
inline constexpr double kMaxShadingAngleRad = 0.6;

// Computes a normal that varies smoothly over the surface, for the direction of the force.
//
// H is flat within a tetrahedron, and the gradient of V jumps between cells. Central differences at
// the corners of a cell, interpolated within the cell, give a gradient that is continuous
// everywhere. Voxels, not H's lattice: the normal is as smooth for every refinement.
//
// Frame: D. Threads: pure. Real-time: no allocation, bounded.
//
// Returns the unit normal at p_I (inside the padded voxels) towards free space.
// It is within kMaxShadingAngleRad of `normal_D` (unit).
Vec3 ShadedNormal(const HapticSurface& surface, const Vec3& p_I, const Vec3& normal_D) noexcept;

// The forces of a haptic update, once the proxy is placed.
//
// Frame: D (mm, N). Threads: pure. Real-time: no allocation, no locks.

// Spring and damper of a layer. The damper acts along the normal and never pulls inwards.
// `normal_D`: the normal of the contact, or the shaded one. The spring is turned from the contact's
// normal to `normal_D`.
Vec3 ContactForce(const HapticLayer& layer, const ProxyStep& step, const Vec3& normal_D,
                  const Vec3& spring_D_n, const Vec3& velocity_mm_per_s) noexcept;

// Drag against the stylus's motion.
Vec3 ViscousForce(double viscosity_n_s_per_m, const Vec3& velocity_mm_per_s) noexcept;

// Pulls a point in free space towards H (of a surface with refinement 1, which bounds the time).
// The force is zero on H and at the magnet's range, and greatest half way. The range is at most
// MaxNearestMm(). Where the nearest point jumps from one wall to another, the direction jumps too.
Vec3 MagneticForce(const HapticSurface& surface, const HapticSettings& settings, const Vec3& p_D,
                   CellCache& cache) noexcept;

}  // namespace palpate
