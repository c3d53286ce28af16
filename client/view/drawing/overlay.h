// Everything drawn besides the volume, as triangles and lines: the three points, the force, the
// stylus, the target of a led hand, the wireframe of H, the lattice's box with the letters of the
// patient's axes, the tool, and balls of the brush and of the tip.
//
// In front of the surface, points and stylus are solid bodies: HIP a ball, SCP_H a cube, SCP_V an
// octahedron. Behind the surface they are hollow: outlines and dashes.
//
// Frame: D (mm). Threads: plain values and pure functions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "client/sdk/pose.h"
#include "client/view/drawing/camera.h"
#include "client/view/drawing/view_options.h"
#include "client/view/volume/view_volume.h"
#include "common/contract/render.h"

namespace palpate::view {

using Rgba8 = std::array<std::uint8_t, 4>;  // red, green, blue, alpha

struct SolidVertex {
  Eigen::Vector3f position_D;
  Eigen::Vector3f normal;  // of length 1
  Rgba8 rgba;
  std::uint8_t alpha_behind = 0;  // where the surface hides it; 0: invisible there
};
struct LineVertex {
  Eigen::Vector3f position_D;
  Rgba8 rgba;                     // alpha 0: visible only where the surface hides it
  std::uint8_t alpha_behind = 0;  // where the surface hides it; 0: invisible there
};

struct Overlay {
  std::vector<SolidVertex> solids;  // three to a triangle
  std::vector<LineVertex> lines;    // two to a line
};

// Colours of the three points in all pictures, plots and panels.
inline constexpr Rgba8 kHipColor = {235, 75, 60, 255};
inline constexpr Rgba8 kScpHColor = {60, 200, 90, 255};
inline constexpr Rgba8 kScpVColor = {70, 130, 255, 255};
inline constexpr Rgba8 kForceColor = {255, 205, 60, 255};
inline constexpr Rgba8 kHapticSurfaceColor = {200, 60, 190, 255};

// Sizes on the screen that do not change when the camera moves.
inline constexpr double kPointRadius_px = 7.0;
inline constexpr double kGreatestForce_px = 220.0;  // the arrow's length at max_force_n

struct OverlayScene {
  std::optional<client::Pose> pose{};
  // Wireframe of H in I, from HapticPatch: pairs of points.
  std::vector<Vec3> haptic_lines_I{};
  std::optional<AffineMap> X_DI{};
  Vec3i lattice_size = Vec3i::Zero();
  // The linear part of the volume's map to P (patient_axes.h). None: no letters.
  std::optional<Mat3> P_from_I{};
  double max_force_n = 3.3;
  double max_torque_n_mm = 0.0;  // 0: the device has no torque
  HeldTool tool{};               // that is felt, where the pose has its orientation
  // Where the person who leads the hand wants HIP to be. None: nobody leads it here.
  std::optional<Vec3> hand_target_D{};
};

// `size`: of the view on the screen, also if the picture has fewer pixels. In free motion HIP and
// SCP_H are the same point, which is drawn as HIP.
Overlay BuildOverlay(const OverlayScene& scene, const OverlayOptions& options, const Camera& camera,
                     const ImageSize& size);

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
