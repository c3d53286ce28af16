// Coulomb friction of the proxy on H.
//
// The proxy first finds where it would rest without friction. Its way there is
// compared with the depth of the HIP below that point: within the static share of
// it the proxy stays where it is, beyond it follows at the dynamic share. On a
// plane that is the friction cone. Both are steps of the frictionless proxy towards
// another target, so that all it promises holds with friction too.
//
// Frame: D (mm). Threads: pure; one thread per state. Real-time: no allocation, no
// locks; at most three proxy steps.
#pragma once

#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"

namespace palpate {

// As StepProxy; `sticking` is carried from step to step. normal_D is that of the
// frictionless rest, so that the force leans away from it as friction does.
ProxyStep StepWithFriction(const HapticSurface& surface, const HapticSettings& settings,
                           const Vec3& p_DHip_mm, double eject_limit_mm, Proxy& proxy,
                           bool& sticking, CellCache& cache) noexcept;

}  // namespace palpate
