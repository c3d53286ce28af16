// Coulomb friction of the proxy on H.
//
// HIP - SCP_H has a part that H holds, along its normal, and one that it does not.
// While the second is within the static share of the first, the proxy stays where it
// is. Beyond that it slides: towards where it would rest without friction, but for
// the dynamic share of the depth there. Both are steps of the frictionless proxy
// towards another target, so that all it promises holds with friction too.
//
// Where the surface moves, a proxy at rest on it is lifted with it, or sinks along the
// normal until it meets it, and sticks there.
//
// Frame: D (mm). Threads: pure; one thread per state. Real-time: no allocation, no
// locks; at most four proxy steps.
#pragma once

#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"

namespace palpate {

// Carried from step to step.
struct FrictionState {
  bool sticking = false;
  Vec3 normal_D = Vec3::Zero();  // of the last contact
};

// As StepProxy. normal_D is the direction in
// which H pushes at SCP_H; the force leans away from it as friction does.
ProxyStep StepWithFriction(const HapticSurface& surface, const HapticSettings& settings,
                           const Vec3& p_DHip_mm, double eject_limit_mm, Proxy& proxy,
                           FrictionState& state, CellCache& cache) noexcept;

}  // namespace palpate
