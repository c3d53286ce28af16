#include "client/view/drawing/tool_drawing.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "client/view/drawing/brush_ball.h"
#include "client/view/drawing/lines.h"
#include "client/view/drawing/solids.h"

namespace palpate::view {
namespace {

constexpr Paint kSteel = {{188, 192, 200, 255}, kGhostBody};
constexpr Paint kCarving = {{214, 186, 120, 255}, kGhostBody};
constexpr Rgba8 kWantedColor = {245, 245, 245, 200};
constexpr std::uint8_t kWantedBehind = 120;
// A point, and a ball from afar.
constexpr double kLeastRadius_px = 2.5;
// The hand is where the tool is, but for this.
constexpr double kSame_mm = 0.05, kSame_rad = 0.005;
constexpr double kTorqueRadius_px = 60.0;
constexpr double kLeastTorque = 0.01;  // of the greatest; less is not visible
constexpr int kArcParts = 48;

double RadiusOf(const HeldToolBall& ball, const Vec3& center_D, const Projection& projection) {
  return std::max(ball.radius_mm, kLeastRadius_px * projection.MmPerPixel(center_D));
}

// Outlines that lie on one another would only be thick: of a shaft's, every so many.
void AddWanted(const Vec3& tip_D, const Eigen::Quaterniond& R_DS, const HeldTool& tool,
               const Projection& projection, Overlay& overlay) {
  constexpr std::size_t kMostOutlines = 16;
  const std::size_t step = std::max<std::size_t>(1, tool.ball.size() / kMostOutlines);
  for (std::size_t n = 0; n < tool.ball.size(); ++n) {
    if (n % step != 0 && n + 1 != tool.ball.size()) continue;
    const Vec3 center_D = tip_D + R_DS * tool.ball[n].center_mm;
    const auto outline =
        OutlineOf(center_D, RadiusOf(tool.ball[n], center_D, projection), projection.eye_D());
    if (!outline) continue;
    AddOutline(PolygonAbout(outline->axis, outline->center_D, outline->radius_mm, 24), kWantedColor,
               kWantedBehind, overlay);
  }
}

}  // namespace

void AddTool(const client::Pose& pose, const HeldTool& tool, const Projection& projection,
             Overlay& overlay) {
  if (!pose.tool_orientation) return;
  const Eigen::Quaterniond felt = Eigen::Quaterniond(*pose.tool_orientation).normalized();
  const Eigen::Quaterniond wanted = Eigen::Quaterniond(pose.stylus_orientation).normalized();
  for (std::size_t n = 0; n < tool.ball.size(); ++n) {
    const HeldToolBall& ball = tool.ball[n];
    const bool touches = n < 64 && (pose.touching_balls >> n & 1) != 0;
    const Paint touching = {kScpHColor, kGhostBody};
    const Vec3 center_D = pose.scp_h_mm + felt * ball.center_mm;
    AddSphere(center_D, RadiusOf(ball, center_D, projection),
              touches       ? touching
              : ball.carves ? kCarving
                            : kSteel,
              overlay.solids);
  }
  if ((pose.hip_mm - pose.scp_h_mm).norm() > kSame_mm || felt.angularDistance(wanted) > kSame_rad) {
    AddWanted(pose.hip_mm, wanted, tool, projection, overlay);
  }
}

void AddTorque(const client::Pose& pose, double max_torque_n_mm, const Projection& projection,
               Overlay& overlay) {
  const double torque_n_mm = pose.torque_n_mm.norm();
  if (!(max_torque_n_mm > 0.0) || !(torque_n_mm > kLeastTorque * max_torque_n_mm)) return;
  const double share = std::min(1.0, torque_n_mm / max_torque_n_mm);
  const Vec3 axis = pose.torque_n_mm / torque_n_mm, x = axis.unitOrthogonal(), y = axis.cross(x);
  const double px_mm = projection.MmPerPixel(pose.scp_h_mm), radius_mm = kTorqueRadius_px * px_mm;
  const double angle_rad = 1.5 * std::numbers::pi * share;
  const auto at = [&](double rad) -> Vec3 {
    return pose.scp_h_mm + radius_mm * (std::cos(rad) * x + std::sin(rad) * y);
  };
  const Paint paint = {kForceColor, kGhostBody};
  const auto add = [&](const Vec3& from_D, const Vec3& to_D, double from_mm, double to_mm) {
    const double length_mm = (to_D - from_D).norm();
    const Ring rings[] = {{0.0, 0.0, paint},
                          {0.0, from_mm, paint},
                          {length_mm, to_mm, paint},
                          {length_mm, 0.0, paint}};
    AddTurned(from_D, (to_D - from_D) / length_mm, rings, overlay.solids);
  };
  const int parts = std::max(2, static_cast<int>(share * kArcParts));
  for (int n = 0; n < parts; ++n) {
    add(at(angle_rad * n / parts), at(angle_rad * (n + 1) / parts), 2.2 * px_mm, 2.2 * px_mm);
  }
  const Vec3 end_D = at(angle_rad), along = axis.cross(end_D - pose.scp_h_mm).normalized();
  add(end_D, end_D + 14.0 * px_mm * along, 6.0 * px_mm, 0.0);
}

}  // namespace palpate::view
