#include "client/view/scene/brush_ball.h"

#include <cmath>

#include "client/view/scene/lines.h"
#include "client/view/scene/solids.h"

namespace palpate::view {
namespace {

constexpr int kOutlineSides = 96;
constexpr Rgba8 kBallColor = {90, 225, 255, 80};
constexpr std::uint8_t kBallBehind = 22;
constexpr Rgba8 kOutlineColor = {170, 240, 255, 255};
constexpr Rgba8 kFadeColor = {170, 240, 255, 110};
constexpr std::uint8_t kOutlineBehind = 150;
constexpr std::uint8_t kFadeBehind = 60;

void AddOutline(const SphereOutline& outline, const Rgba8& rgba, std::uint8_t alpha_behind,
                Overlay& overlay) {
  AddOutline(PolygonAbout(outline.axis, outline.center_D, outline.radius_mm, kOutlineSides), rgba,
             alpha_behind, overlay);
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

void AddBrushBall(const Vec3& center_D, double radius_mm, double fade_mm,
                  const Projection& projection, Overlay& overlay) {
  // Half a pixel outside of the ball, which would hide half of the line.
  const double aside_mm = 0.5 * projection.MmPerPixel(center_D);
  const auto outline = OutlineOf(center_D, radius_mm + aside_mm, projection.eye_D());
  if (!outline) return;
  AddSphere(center_D, radius_mm, {kBallColor, kBallBehind}, overlay.solids);
  AddOutline(*outline, kOutlineColor, kOutlineBehind, overlay);
  if (fade_mm <= 0.0) return;
  if (const auto fade = OutlineOf(center_D, radius_mm + fade_mm + aside_mm, projection.eye_D())) {
    AddOutline(*fade, kFadeColor, kFadeBehind, overlay);
  }
}

}  // namespace palpate::view
