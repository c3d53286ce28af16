#include "client/view/scene/brush_ball.h"

#include <cmath>
#include <numbers>

#include "client/view/scene/solids.h"

namespace palpate::view {
namespace {

constexpr int kOutlineSides = 96;
constexpr std::array<std::uint8_t, 4> kBallColor = {90, 225, 255, 80};
constexpr std::uint8_t kBallBehind = 22;
constexpr std::array<std::uint8_t, 4> kOutlineColor = {170, 240, 255, 255};
constexpr std::array<std::uint8_t, 4> kFadeColor = {170, 240, 255, 110};
constexpr std::uint8_t kOutlineBehind = 150;
constexpr std::uint8_t kFadeBehind = 60;

void AddOutline(const SphereOutline& outline, const std::array<std::uint8_t, 4>& rgba,
                std::uint8_t alpha_behind, Overlay& overlay) {
  const Vec3 across = outline.axis.unitOrthogonal();
  const Vec3 other = outline.axis.cross(across);
  const auto corner = [&](int side) -> Eigen::Vector3f {
    const double angle = 2.0 * std::numbers::pi * side / kOutlineSides;
    const Vec3 out = std::cos(angle) * across + std::sin(angle) * other;
    return (outline.center_D + outline.radius_mm * out).cast<float>();
  };
  for (int side = 0; side < kOutlineSides; ++side) {
    overlay.lines.push_back({corner(side), rgba, alpha_behind});
    overlay.lines.push_back({corner((side + 1) % kOutlineSides), rgba, alpha_behind});
  }
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
