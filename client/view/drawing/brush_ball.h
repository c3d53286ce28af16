// Balls in the view: of the edit brush, and at the stylus's tip.
//
// Frame: D (mm). Threads: pure.
#pragma once

#include "client/view/drawing/camera.h"
#include "client/view/drawing/overlay.h"

namespace palpate::view {

// The line around a sphere as the eye sees it.
struct SphereOutline {
  Vec3 center_D = Vec3::Zero();
  double radius_mm = 0.0;
  Vec3 axis = Vec3::UnitZ();  // of length 1, to the eye
};
// None: the eye is within the sphere.
std::optional<SphereOutline> OutlineOf(const Vec3& center_D, double radius_mm, const Vec3& eye_D);

// Adds a ball, clear enough to see what is under it, and its outline. What the surface hides of
// them is fainter, so that one sees where the ball meets the surface.
void AddBall(const Vec3& center_D, double radius_mm, const Rgba8& rgba,
             const Projection& projection, Overlay& overlay);
// Adds fainter the outline of where the fade ends, too.
void AddBrushBall(const Vec3& center_D, double radius_mm, double fade_mm,
                  const Projection& projection, Overlay& overlay);

}  // namespace palpate::view
