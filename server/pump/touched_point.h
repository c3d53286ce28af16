// The point where a ball touches the isosurface V that stops it.
//
// It is the first point of V on the way to where the sphere has the volume's greatest felt density:
// the sphere itself is known to a fraction of a voxel only. If V is not met there, it is the
// nearest point that is met on other ways. In a crease the ball touches several points; this is one
// of them, and goes from one to another.
//
// Frame: D (mm). Threads: pure; bounded, about 10 us. Not for the servo thread.
#pragma once

#include "server/haptics/visual_proxy.h"

namespace palpate {

// `surface`: of the volume, with the τ that stops the ball.
VisualProxy FindTouchedPoint(const HapticSurface& surface, const Vec3& center_D_mm,
                             double radius_mm) noexcept;

}  // namespace palpate
