#include "client/view/drawing/overlay.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/shapes.h"
#include "common/contract/render.h"

namespace palpate::view {
namespace {

// A rigid tool in the view: as it is felt, where the hand wants it, which balls hold it back, and
// the torque on the hand.
//
// Frame: D (mm). Threads: pure.

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

// The tool as it is felt is solid, its touching balls in the proxy's colour. Where the hand wants
// it, outlines show it, unless it is there.
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

// An arc about the torque's axis around SCP_H; at the greatest torque three quarters of a circle.
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

constexpr std::uint8_t kForceBehind = 100;
constexpr std::uint8_t kHapticSurfaceBehind = 70;
constexpr Rgba8 kSpringColor = {245, 245, 245, 230};  // HIP to SCP_H
constexpr Rgba8 kGapColor = {160, 195, 255, 255};     // SCP_H to SCP_V
constexpr Rgba8 kBoxColor = {128, 140, 158, 150};
constexpr Paint kPenBody = {{66, 74, 88, 255}, kGhostBody};
constexpr Paint kPenGrip = {{128, 138, 152, 255}, kGhostBody};
constexpr Paint kPenTip = {{205, 208, 212, 255}, kGhostBody};
// The line from HIP to the target of a led hand: without force, and at the greatest force.
constexpr Rgba8 kTargetColor = {255, 255, 255, 255};
constexpr Rgba8 kStrainColor = {255, 60, 30, 255};
constexpr std::uint8_t kTargetBehind = 210;
constexpr double kTargetRadius_px = 11.0;

// Shorter arrows would not be visible.
constexpr double kLeastArrow_px = 1.0;
// Voxels of this size on the screen leave room between the lines of H.
constexpr double kSparse_px = 36.0;
constexpr double kLetter_px = 16.0;
constexpr double kDash_px = 5.0;

// Solid in front of the surface, dashed behind it.
void AddLink(const Vec3& from_D, const Vec3& to_D, const Rgba8& rgba, const Projection& projection,
             Overlay& overlay) {
  AddLine(from_D, to_D, rgba, 0, overlay);
  AddGhostDashes(from_D, to_D, kDash_px * projection.MmPerPixel(from_D), rgba, overlay);
}

// A polygon that faces the eye. Its first corner is at the angle from the view's right.
std::vector<Vec3> FacingPolygon(const Vec3& center_D, double radius_mm, int corners,
                                double first_deg, const Mat3& R_DV) {
  return Polygon(center_D, radius_mm, corners, R_DV.col(0), R_DV.col(1),
                 first_deg * std::numbers::pi / 180.0);
}

// Shapes that look different at the size of a few pixels: they keep their side to the eye.
void AddHip(const Vec3& p_D, double radius_mm, const Mat3& R_DV, Overlay& overlay) {
  AddSphere(p_D, radius_mm, {kHipColor, kGhostBody}, overlay.solids);
  AddGhostOutline(FacingPolygon(p_D, radius_mm, 20, 0.0, R_DV), kHipColor, overlay);
}

void AddScpH(const Vec3& p_D, double radius_mm, const Mat3& R_DV, Overlay& overlay) {
  // Turned a little, so that a cube looks like one.
  static const Mat3 kTurn =
      (Eigen::AngleAxisd(0.35, Vec3::UnitX()) * Eigen::AngleAxisd(0.45, Vec3::UnitY()))
          .toRotationMatrix();
  AddCube(p_D, 0.75 * radius_mm, R_DV * kTurn, {kScpHColor, kGhostBody}, overlay.solids);
  AddGhostOutline(FacingPolygon(p_D, 1.25 * radius_mm, 4, 45.0, R_DV), kScpHColor, overlay);
}

void AddScpV(const Vec3& p_D, double radius_mm, const Mat3& R_DV, Overlay& overlay) {
  AddOctahedron(p_D, 1.25 * radius_mm, R_DV, {kScpVColor, kGhostBody}, overlay.solids);
  AddGhostOutline(FacingPolygon(p_D, 1.25 * radius_mm, 4, 0.0, R_DV), kScpVColor, overlay);
}

void AddPoints(const client::Pose& pose, const Projection& projection, Overlay& overlay) {
  const Mat3 R_DV = projection.R_DV();
  const auto radius_mm = [&](const Vec3& p_D) {
    return kPointRadius_px * projection.MmPerPixel(p_D);
  };
  AddHip(pose.hip_mm, radius_mm(pose.hip_mm), R_DV, overlay);
  if (pose.scp_h_mm != pose.hip_mm) {
    AddScpH(pose.scp_h_mm, radius_mm(pose.scp_h_mm), R_DV, overlay);
    AddLink(pose.hip_mm, pose.scp_h_mm, kSpringColor, projection, overlay);
  }
  if (pose.scp_v_mm) {
    AddScpV(*pose.scp_v_mm, radius_mm(*pose.scp_v_mm), R_DV, overlay);
    AddLink(pose.scp_h_mm, *pose.scp_v_mm, kGapColor, projection, overlay);
  }
}

// A ring where the hand wants to be, and a band to HIP: long and red if the surface resists.
void AddHandTarget(const OverlayScene& scene, const Projection& projection, Overlay& overlay) {
  const Vec3& target_D = *scene.hand_target_D;
  const Mat3 R_DV = projection.R_DV();
  const double px_mm = projection.MmPerPixel(target_D);
  const auto ring = FacingPolygon(target_D, kTargetRadius_px * px_mm, 24, 0.0, R_DV);
  AddOutline(ring, kTargetColor, kTargetBehind, overlay);
  const Vec3 from_hip_D = target_D - scene.pose->hip_mm;
  const double length_mm = from_hip_D.norm();
  if (length_mm < px_mm) return;
  const double share =
      scene.max_force_n > 0.0 ? std::min(1.0, scene.pose->force_n.norm() / scene.max_force_n) : 0.0;
  Paint paint = {kTargetColor, kTargetBehind};
  for (std::size_t n = 0; n < 3; ++n) {
    paint.rgba[n] = static_cast<std::uint8_t>(
        kTargetColor[n] + std::sqrt(share) * (kStrainColor[n] - kTargetColor[n]));
  }
  const double radius_mm = 1.6 * px_mm;
  const Ring rings[] = {{0.0, 0.0, paint},
                        {0.0, radius_mm, paint},
                        {length_mm, radius_mm, paint},
                        {length_mm, 0.0, paint}};
  AddTurned(scene.pose->hip_mm, from_hip_D / length_mm, rings, overlay.solids);
}

void AddForce(const client::Pose& pose, double max_force_n, const Projection& projection,
              Overlay& overlay) {
  const double force_n = pose.force_n.norm();
  if (!(max_force_n > 0.0)) return;
  const double length_px = kGreatestForce_px * force_n / max_force_n;
  if (!(length_px > kLeastArrow_px)) return;
  const double px_mm = projection.MmPerPixel(pose.scp_h_mm);
  const double head_px = std::min(16.0, length_px);
  const Paint paint = {kForceColor, kForceBehind};
  const double neck_mm = (length_px - head_px) * px_mm;
  const Ring rings[] = {{0.0, 0.0, paint},
                        {0.0, 2.2 * px_mm, paint},
                        {neck_mm, 2.2 * px_mm, paint},
                        {neck_mm, 6.0 * px_mm, paint},
                        {length_px * px_mm, 0.0, paint}};
  AddTurned(pose.scp_h_mm, pose.force_n / force_n, rings, overlay.solids);
}

// Sizes in mm, because the stylus is an object of the workspace. Its tip is at HIP, and it points
// along its own -z.
void AddStylus(const client::Pose& pose, const Projection& projection, Overlay& overlay) {
  static constexpr Ring kRings[] = {
      {0.0, 0.0, kPenTip},   {1.0, 0.35, kPenTip},  {14.0, 2.3, kPenGrip}, {15.0, 2.7, kPenGrip},
      {26.0, 2.9, kPenGrip}, {26.6, 2.6, kPenBody}, {27.2, 2.9, kPenBody}, {66.0, 2.9, kPenBody},
      {67.8, 2.6, kPenBody}, {69.2, 1.8, kPenBody}, {70.0, 0.0, kPenBody}};
  const Vec3 away_from_tip =
      Eigen::Quaterniond(pose.stylus_orientation).normalized() * Vec3::UnitZ();
  AddTurned(pose.hip_mm, away_from_tip, kRings, overlay.solids);
  AddGhostEdges(pose.hip_mm, away_from_tip, kRings, projection.eye_D(),
                kDash_px * projection.MmPerPixel(pose.hip_mm), overlay);
}

// Where V and H coincide, half of a line's width would lie behind a slanted surface. So lines move
// nearer to the eye:
// - by half a pixel, because a smaller difference is not visible anyway
// - by a fraction of a voxel, so small that a line between V and H stays between them
// Lines that V hides by less than a voxel are faintly visible. Lines farther behind V are hidden,
// because they would only confuse.
void AddHapticSurface(const OverlayScene& scene, const Projection& projection, Overlay& overlay) {
  const Vec3 eye_D = projection.eye_D();
  const double voxel_mm = scene.X_DI->linear.colwise().norm().minCoeff();
  const auto add = [&](double nearer_voxels, std::uint8_t alpha) {
    for (const Vec3& p_I : scene.haptic_lines_I) {
      const Vec3 p_D = scene.X_DI->Apply(p_I);
      const double px_mm = projection.MmPerPixel(p_D);
      const double nearer_mm = nearer_voxels * voxel_mm + 0.5 * px_mm;
      // From afar, lines are so dense that they would cover the surface.
      const double share = std::clamp(voxel_mm / px_mm / kSparse_px, 0.2, 1.0);
      auto rgba = kHapticSurfaceColor;
      rgba[3] = static_cast<std::uint8_t>(share * alpha);
      overlay.lines.push_back(
          {(p_D + nearer_mm * (eye_D - p_D).normalized()).cast<float>(), rgba, 0});
    }
  };
  add(0.75, kHapticSurfaceBehind);
  add(0.02, kHapticSurfaceColor[3]);
}

// Beside the middle of each face. A letter on the line of sight would tell nothing, and cover what
// is looked at.
void AddBoxLetters(const OverlayScene& scene, const Projection& projection, Overlay& overlay) {
  constexpr double kAlongSight = 0.8;
  const Vec3 edges = scene.lattice_size.cast<double>();
  const Vec3 center_D = scene.X_DI->Apply(0.5 * (edges - Vec3::Ones()));
  const Mat3 R_DV = projection.R_DV();
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    const double sign = face % 2 == 0 ? 1.0 : -1.0;
    const Vec3 to_face_D = 0.5 * sign * edges[axis] * scene.X_DI->linear.col(axis);
    const Vec3 outward_D = to_face_D.normalized();
    if (std::abs(outward_D.dot(R_DV.col(2))) > kAlongSight) continue;
    const Vec3 face_D = center_D + to_face_D;
    const double height_mm = kLetter_px * projection.MmPerPixel(face_D);
    AddLetters(LettersOf(sign * scene.P_from_I->col(axis)), face_D + height_mm * outward_D,
               height_mm * R_DV.col(0), height_mm * R_DV.col(1), overlay);
  }
}

}  // namespace

Overlay BuildOverlay(const OverlayScene& scene, const OverlayOptions& options, const Camera& camera,
                     const ImageSize& size) {
  Overlay overlay;
  const Projection projection(camera, size);
  if (scene.X_DI && options.box && (scene.lattice_size.array() > 0).all()) {
    // Along the outer faces of the outermost voxels.
    const Vec3 min_I = Vec3::Constant(-0.5);
    AddBox(*scene.X_DI, min_I, min_I + scene.lattice_size.cast<double>(), kBoxColor, 0, overlay);
    if (scene.P_from_I && options.letters) AddBoxLetters(scene, projection, overlay);
  }
  if (scene.X_DI && options.haptic_surface) {
    AddHapticSurface(scene, projection, overlay);
  }
  if (!scene.pose) return overlay;
  if (options.points) AddPoints(*scene.pose, projection, overlay);
  if (options.points && scene.pose->tool_radius_mm > 0.0) {
    AddBall(scene.pose->scp_h_mm, scene.pose->tool_radius_mm, kScpHColor, projection, overlay);
  }
  if (options.force) {
    AddForce(*scene.pose, scene.max_force_n, projection, overlay);
    AddTorque(*scene.pose, scene.max_torque_n_mm, projection, overlay);
  }
  if (options.stylus) {
    if (scene.pose->tool_orientation && !scene.tool.ball.empty()) {
      AddTool(*scene.pose, scene.tool, projection, overlay);
    } else {
      AddStylus(*scene.pose, projection, overlay);
    }
  }
  if (scene.hand_target_D) AddHandTarget(scene, projection, overlay);
  return overlay;
}

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
