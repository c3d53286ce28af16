// Computes a normal that varies smoothly over the surface, for the direction of the force.
//
// H is flat within a tetrahedron, and the gradient of V jumps between cells. Central differences at
// the corners of a cell, interpolated within the cell, give a gradient that is continuous
// everywhere. Voxels, not H's lattice: the normal is as smooth for every refinement.
//
// Frame: D. Threads: pure. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/haptic_surface.h"

namespace palpate {

// The greatest angle between the smooth normal and the normal of H. Where the density does not look
// like a surface, H decides.
inline constexpr double kMaxShadingAngleRad = 0.6;

// Returns the unit normal at p_I (inside the padded voxels) towards free space.
// It is within kMaxShadingAngleRad of `normal_D` (unit).
Vec3 ShadedNormal(const HapticSurface& surface, const Vec3& p_I, const Vec3& normal_D) noexcept;

}  // namespace palpate
