#include "client/view/drawing/brush_ball.h"

#include <cmath>

#include "client/view/drawing/lines.h"
#include "client/view/drawing/solids.h"

namespace palpate::view {
namespace {

constexpr int kOutlineSides = 96;
constexpr Rgba8 kBrushColor = {90, 225, 255, 255};
constexpr std::uint8_t kBallAlpha = 80;
constexpr std::uint8_t kBallBehind = 22;
constexpr Rgba8 kFadeColor = {170, 240, 255, 110};
constexpr std::uint8_t kOutlineBehind = 150;
constexpr std::uint8_t kFadeBehind = 60;

void AddOutline(const SphereOutline& outline, const Rgba8& rgba, std::uint8_t alpha_behind,
                Overlay& overlay) {
  AddOutline(PolygonAbout(outline.axis, outline.center_D, outline.radius_mm, kOutlineSides), rgba,
             alpha_behind, overlay);
}

// Half a pixel outside of the ball, which would hide half of the line.
double Aside(const Vec3& center_D, const Projection& projection) {
  return 0.5 * projection.MmPerPixel(center_D);
}

}  // namespace

std::optional<SphereOutline> OutlineOf(const Vec3& center_D, double radius_mm, const Vec3& eye_D) {
  const double distance_mm = (eye_D - center_D).norm();
  if (!(distance_mm > radius_mm)) return std::nullopt;
  // The tangents from the eye touch the sphere in a circle nearer to the eye than the centre.
  const double share = radius_mm / distance_mm;
  const Vec3 axis = (eye_D - center_D) / distance_mm;
  return SphereOutline{.center_D = center_D + share * radius_mm * axis,
                       .radius_mm = radius_mm * std::sqrt(1.0 - share * share),
                       .axis = axis};
}

void AddBall(const Vec3& center_D, double radius_mm, const Rgba8& rgba,
             const Projection& projection, Overlay& overlay) {
  const auto outline =
      OutlineOf(center_D, radius_mm + Aside(center_D, projection), projection.eye_D());
  if (!outline) return;
  Rgba8 body = rgba, line = rgba;
  body[3] = kBallAlpha;
  for (int n = 0; n < 3; ++n) line[n] = static_cast<std::uint8_t>(255 - (255 - rgba[n]) / 2);
  AddSphere(center_D, radius_mm, {body, kBallBehind}, overlay.solids);
  AddOutline(*outline, line, kOutlineBehind, overlay);
}

void AddBrushBall(const Vec3& center_D, double radius_mm, double fade_mm,
                  const Projection& projection, Overlay& overlay) {
  AddBall(center_D, radius_mm, kBrushColor, projection, overlay);
  if (fade_mm <= 0.0) return;
  const double aside_mm = Aside(center_D, projection);
  if (const auto fade = OutlineOf(center_D, radius_mm + fade_mm + aside_mm, projection.eye_D())) {
    AddOutline(*fade, kFadeColor, kFadeBehind, overlay);
  }
}

}  // namespace palpate::view
