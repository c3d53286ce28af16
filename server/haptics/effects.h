// The forces of a haptic update, once the proxy is placed.
//
// Frame: D (mm, N). Threads: pure. Real-time: no allocation, no locks.
#pragma once

#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"

namespace palpate {

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
