// Moves the isovalue at a bounded rate while the stylus touches the surface.
//
// A step from bone to skin would put the surface centimetres away from the stylus in one tick: the
// proxy would be lost in the object. With the glide the surface carries the proxy along, as a
// dragged slider would. In free space a new isovalue applies at once.
//
// The last isovalue is the one that the proxy remembers, so the glide has no state of its own, and
// replays compute it again.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation, no locks; one cell.
#pragma once

#include "server/haptics/haptic_surface.h"
#include "server/haptics/renderer.h"

namespace palpate {

// The rate is chosen so that the surface passes the proxy at this speed.
inline constexpr double kGlideSpeedMmPerS = 50.0;
// Bounds of the rate, in ranges of the volume per second. The lower one crosses flat regions.
inline constexpr double kMinGlidePerS = 0.25;
inline constexpr double kMaxGlidePerS = 2.0;
// A longer tick glides no farther than this one.
inline constexpr double kLongestGlideTickS = 5e-3;

// The isovalue (normalised, felt on the side of `surface`) for the next StepRenderer.
//
// `surface`: with the isovalue that was asked for. It is returned where the stylus touches nothing
// and keeps out of the object, where the proxy is buried, and where the loaded volume or the side
// are new. A new place glides: a placement that changes nothing must not end a glide.
double GlideIsovalue(const HapticSurface& surface, double dt_s, RendererState& state) noexcept;

}  // namespace palpate
