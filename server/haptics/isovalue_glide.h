// Moves the isovalue at a bounded rate while the stylus touches the surface.
//
// A step from bone to skin would put the surface centimetres away from the stylus in one tick: the
// proxy would be lost in the object. With the glide the surface carries the proxy along, as a
// dragged slider would. In free space a new isovalue applies at once.
//
// The last isovalues are those that the proxy remembers, so the glide has no state of its own, and
// replays compute it again.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation, no locks; one cell.
#pragma once

#include <optional>

#include "server/haptics/proxy.h"

namespace palpate {

// The rate is chosen so that the surface passes the proxy at this speed.
inline constexpr double kGlideSpeedMmPerS = 50.0;
// Bounds of the rate, in ranges of the volume per second. The lower one crosses flat regions.
inline constexpr double kMinGlidePerS = 0.25;
inline constexpr double kMaxGlidePerS = 2.0;
// A longer tick glides no farther than this one.
inline constexpr double kLongestGlideTickS = 5e-3;

// The bounds of free space for the next step, towards those of `surface`, which were asked for.
struct GlidingBounds {
  double isovalue = 0.0;
  double lower = 0.0;
};

// Empty: those of `surface`, at once. So it is where the stylus touches nothing and keeps out of
// the object, where the proxy is buried, and where the loaded volume or the side are new. A new
// place glides: a placement that changes nothing must not end a glide. A bound that was not there
// before does not glide, and none does if they would cross.
std::optional<GlidingBounds> Glide(const HapticSurface& surface, double dt_s, const Proxy& proxy,
                                   CellCache& cache) noexcept;

}  // namespace palpate
