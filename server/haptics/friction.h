// Coulomb friction of the proxy on H.
//
// HIP - SCP_H has a part that H holds, along its normal, and a part that H does not hold. The proxy
// stays where it is while the second part is within a share of the first: the static share while
// the proxy sticks, the dynamic share while it slides. Otherwise the proxy slides towards the place
// where it would rest without friction, and stops short of it by the dynamic share of the depth
// there. Both cases are steps of the frictionless proxy towards another target, so all its
// guarantees hold with friction, too.
//
// A grain adds to the dynamic share: between none and texture_force_n, much like a cosine of the
// way that the proxy has slid. So whichever way the stylus strokes, it feels one wavelength.
// Friction only takes energy: the spring from the HIP to the proxy is passive while the proxy only
// moves towards the HIP, whatever the share is.
//
// If the surface moves, a proxy at rest on it is lifted with it, or sinks along the normal until it
// meets the surface, and sticks there.
//
// Frame: D (mm). Threads: pure; one thread per state. Real-time: no allocation, no
// locks; at most four proxy steps.
#pragma once

#include "server/haptics/proxy.h"

namespace palpate {

// The grain's share of the normal force is at most this: it ends with the contact.
inline constexpr double kMostGrain = 0.5;

// The state between steps.
struct FrictionState {
  bool sticking = false;
  Vec3 normal_D = Vec3::Zero();  // of the last contact
  double slid_mm = 0.0;          // within a wavelength of the grain; 0 without a grain
};

// As StepProxy, with the friction and the stiffness of `layer`. normal_D is the direction in which
// H pushes at SCP_H. The friction tilts the force away from it.
ProxyStep StepWithFriction(const HapticSurface& surface, const HapticLayer& layer,
                           const Vec3& p_DHip_mm, double eject_limit_mm, Proxy& proxy,
                           FrictionState& state, CellCache& cache) noexcept;

}  // namespace palpate
