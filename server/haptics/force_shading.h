// A normal that varies smoothly over the surface, for the direction of the force.
//
// H is flat within a tetrahedron, and the gradient of V jumps between cells. The
// gradient by central differences at the corners of a cell, interpolated within
// it, is continuous everywhere.
//
// Frame: D. Threads: pure. Real-time: no allocation, bounded.
#pragma once

#include "server/haptics/haptic_surface.h"

namespace palpate {

// The smooth normal leans away from the normal of H by this much at most: where the
// density is not like a surface, H decides.
inline constexpr double kMaxShadingAngleRad = 0.6;

// Unit normal at p_I (index coordinates, inside the padded lattice) towards free
// space; within kMaxShadingAngleRad of `normal_D` (unit).
Vec3 ShadedNormal(const HapticSurface& surface, const Vec3& p_I, const Vec3& normal_D) noexcept;

}  // namespace palpate
