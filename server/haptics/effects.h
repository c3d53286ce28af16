// The forces of a haptic update, once the proxy is placed.
//
// Frame: D (mm, N). Threads: pure. Real-time: no allocation, no locks.
#pragma once

#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"

namespace palpate {

// Spring and damper, the latter along the normal and never pulling inwards.
// `normal_D`: the contact's, or the shaded one; the spring is turned from the first
// to the second.
Vec3 ContactForce(const HapticSettings& settings, const ProxyStep& step, const Vec3& normal_D,
                  const Vec3& spring_D_n, const Vec3& velocity_mm_per_s) noexcept;

// Drag against the motion of the stylus.
Vec3 ViscousForce(const HapticSettings& settings, const Vec3& velocity_mm_per_s) noexcept;

// Pull of a point in free space towards H: zero on it and at the magnet's range,
// greatest half way. The range is MaxNearestMm() at most. Where the nearest point jumps from one
// wall to another, so does its direction.
Vec3 MagneticForce(const HapticSurface& surface, const HapticSettings& settings, const Vec3& p_D,
                   CellCache& cache) noexcept;

}  // namespace palpate
