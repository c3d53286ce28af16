#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "client/view/drawing/overlay.h"
#include "client/view/drawing/shapes.h"

namespace palpate::view {
namespace {

using PixelColor = std::array<std::uint8_t, 4>;

constexpr ImageSize kSize = {800, 600};

// Draws nothing but this.
OverlayOptions Only(bool OverlayOptions::*drawn) {
  OverlayOptions options = {
      .points = false, .force = false, .stylus = false, .haptic_surface = false, .box = false};
  options.*drawn = true;
  return options;
}

client::Pose InContact() {
  client::Pose pose;
  pose.contact = true;
  pose.hip_mm = {3.0, -2.0, 5.0};
  pose.scp_h_mm = {3.5, 1.0, 7.0};
  pose.scp_v_mm = Vec3(3.5, 1.25, 7.0);
  pose.force_n = {0.3, 1.2, -0.4};
  return pose;
}

std::vector<SolidVertex> WithColor(const Overlay& overlay, const PixelColor& rgba) {
  std::vector<SolidVertex> found;
  for (const SolidVertex& vertex : overlay.solids) {
    if (vertex.rgba == rgba) found.push_back(vertex);
  }
  return found;
}

// Pixels from the upper left corner.
Eigen::Vector2d OnScreen(const Vec3& p_D, const Camera& camera, const ImageSize& size) {
  const Eigen::Vector4d clip = camera.ClipFromD(size, {}) * p_D.homogeneous();
  return {(0.5 + 0.5 * clip.x() / clip.w()) * size.width,
          (0.5 - 0.5 * clip.y() / clip.w()) * size.height};
}

// Greatest distance on the screen of a body's vertices from a point.
double Radius_px(const std::vector<SolidVertex>& body, const Vec3& center_D, const Camera& camera,
                 const ImageSize& size) {
  double greatest = 0.0;
  for (const SolidVertex& vertex : body) {
    const Vec3 p_D = vertex.position_D.cast<double>();
    greatest =
        std::max(greatest, (OnScreen(p_D, camera, size) - OnScreen(center_D, camera, size)).norm());
  }
  return greatest;
}

// Greatest and least height of vertices along a direction.
struct Extent {
  double least = std::numeric_limits<double>::infinity();
  double greatest = -std::numeric_limits<double>::infinity();
};
Extent Along(const std::vector<SolidVertex>& body, const Vec3& origin_D, const Vec3& direction) {
  Extent extent;
  for (const SolidVertex& vertex : body) {
    const double height = direction.dot(vertex.position_D.cast<double>() - origin_D);
    extent.least = std::min(extent.least, height);
    extent.greatest = std::max(extent.greatest, height);
  }
  return extent;
}

TEST(ViewOverlay, WithoutAPoseThereAreNoPoints) {
  OverlayScene scene;
  scene.X_DI = AffineMap{};
  scene.lattice_size = {4, 5, 6};
  const Overlay overlay = BuildOverlay(scene, {}, {}, kSize);
  EXPECT_TRUE(overlay.solids.empty());
  EXPECT_EQ(overlay.lines.size(), 24u);  // the box
  EXPECT_TRUE(BuildOverlay({}, {}, {}, kSize).lines.empty());
}

std::vector<LineVertex> Lines(const Overlay& overlay, bool ghosts) {
  std::vector<LineVertex> found;
  for (const LineVertex& vertex : overlay.lines) {
    if ((vertex.rgba[3] == 0) == ghosts) found.push_back(vertex);
  }
  return found;
}

// So that colours are not all that tells them apart: a ball, a cube, an octahedron.
TEST(ViewOverlay, EachPointHasAShapeOfItsOwnAroundIt) {
  const OverlayOptions options = Only(&OverlayOptions::points);
  const client::Pose pose = InContact();
  const Overlay overlay = BuildOverlay({.pose = pose}, options, {}, kSize);
  struct Shape {
    PixelColor rgba;
    Vec3 center_D;
    std::size_t faces;
  };
  const Shape shapes[] = {
      {kHipColor, pose.hip_mm, 0}, {kScpHColor, pose.scp_h_mm, 6}, {kScpVColor, *pose.scp_v_mm, 8}};
  std::size_t vertices = 0;
  for (const auto& [rgba, center_D, faces] : shapes) {
    const auto body = WithColor(overlay, rgba);
    vertices += body.size();
    ASSERT_FALSE(body.empty());
    const double radius_mm = (body[0].position_D.cast<double>() - center_D).norm();
    EXPECT_GT(radius_mm, 0.0);
    std::vector<Eigen::Vector3f> normals;
    for (const SolidVertex& vertex : body) {
      const Vec3 out = vertex.position_D.cast<double>() - center_D;
      EXPECT_NEAR(out.norm(), radius_mm, 1e-4);
      EXPECT_GT(out.dot(vertex.normal.cast<double>()), 0.0);
      const auto same = [&](const Eigen::Vector3f& n) {
        return (n - vertex.normal).norm() < 1e-3f;
      };
      if (std::none_of(normals.begin(), normals.end(), same)) normals.push_back(vertex.normal);
    }
    if (faces > 0) {
      EXPECT_EQ(normals.size(), faces);
    } else {
      EXPECT_GT(normals.size(), 100u);
    }
  }
  EXPECT_EQ(vertices, overlay.solids.size());
  const auto links = Lines(overlay, false);
  ASSERT_EQ(links.size(), 4u);
  EXPECT_EQ(links[0].position_D, pose.hip_mm.cast<float>());
  EXPECT_EQ(links[1].position_D, pose.scp_h_mm.cast<float>());
  EXPECT_EQ(links[2].position_D, pose.scp_h_mm.cast<float>());
  EXPECT_EQ(links[3].position_D, pose.scp_v_mm->cast<float>());
}

// A body behind the surface must not look like one before it: an outline, with little in it.
TEST(ViewOverlay, BehindTheSurfaceBodiesAreOutlines) {
  for (const auto drawn : {&OverlayOptions::points, &OverlayOptions::stylus}) {
    const Camera camera;
    const client::Pose pose = InContact();
    const Overlay overlay = BuildOverlay({.pose = pose}, Only(drawn), camera, kSize);
    for (const SolidVertex& vertex : overlay.solids) {
      EXPECT_GT(vertex.alpha_behind, 0);
      EXPECT_LT(vertex.alpha_behind, 64);
    }
    for (const LineVertex& vertex : Lines(overlay, false)) EXPECT_EQ(vertex.alpha_behind, 0);
    const auto ghosts = Lines(overlay, true);
    ASSERT_FALSE(ghosts.empty());
    for (const LineVertex& vertex : ghosts) {
      EXPECT_GT(vertex.alpha_behind, 192);
      EXPECT_TRUE(vertex.position_D.allFinite());
    }
  }
}

// On the screen, the dashes are at the edges of the body.
TEST(ViewOverlay, TheDashesOfTheShaftAreAtItsEdges) {
  Camera camera;
  camera.Set(Vec3::Zero(), 0.0, 0.0, 400.0);  // along -z
  client::Pose pose;
  pose.stylus_orientation = Eigen::Quaterniond(Eigen::AngleAxisd(-1.5707963, Vec3::UnitX()));
  const Overlay overlay =
      BuildOverlay({.pose = pose}, Only(&OverlayOptions::stylus), camera, kSize);
  const auto ghosts = Lines(overlay, true);
  const Extent solid = Along(overlay.solids, Vec3::Zero(), Vec3::UnitX());
  double least = 0.0, greatest = 0.0;
  for (const LineVertex& vertex : ghosts) {
    least = std::min(least, static_cast<double>(vertex.position_D.x()));
    greatest = std::max(greatest, static_cast<double>(vertex.position_D.x()));
    EXPECT_NEAR(vertex.position_D.z(), 0.0f, 1e-3f);
  }
  EXPECT_NEAR(least, solid.least, 0.05);
  EXPECT_NEAR(greatest, solid.greatest, 0.05);
  // Seen along the shaft it has no such edges.
  pose.stylus_orientation = client::UnalignedQuaternion::Identity();
  EXPECT_TRUE(
      Lines(BuildOverlay({.pose = pose}, Only(&OverlayOptions::stylus), camera, kSize), true)
          .empty());
}

// The band shows how far the surface keeps the hand from its target, and how strongly.
TEST(ViewOverlay, ALedHandHasARingAtItsTargetAndABandToHip) {
  OverlayScene scene{.pose = client::Pose{}, .max_force_n = 3.0};
  scene.hand_target_D = Vec3(0.0, 30.0, 0.0);
  const OverlayOptions options = Only(&OverlayOptions::box);
  PixelColor relaxed{}, strained{};
  for (const double force_n : {0.0, 3.0}) {
    scene.pose->force_n = {0.0, -force_n, 0.0};
    const Overlay overlay = BuildOverlay(scene, options, {}, kSize);
    ASSERT_FALSE(overlay.solids.empty());
    (force_n > 0.0 ? strained : relaxed) = overlay.solids[0].rgba;
    const Extent along = Along(overlay.solids, Vec3::Zero(), Vec3::UnitY());
    EXPECT_NEAR(along.least, 0.0, 1e-5);
    EXPECT_NEAR(along.greatest, 30.0, 1e-5);
    Eigen::Vector3f middle = Eigen::Vector3f::Zero();
    for (const LineVertex& vertex : overlay.lines) {
      middle += vertex.position_D / static_cast<float>(overlay.lines.size());
      EXPECT_GT(vertex.alpha_behind, 128);
    }
    EXPECT_LT((middle - scene.hand_target_D->cast<float>()).norm(), 1e-3f);
  }
  EXPECT_LT(strained[1] + 100, relaxed[1]);
  scene.pose->hip_mm = *scene.hand_target_D;
  EXPECT_TRUE(BuildOverlay(scene, options, {}, kSize).solids.empty());
}

TEST(ViewOverlay, InFreeMotionOnePointIsDrawnOnce) {
  const OverlayOptions options = Only(&OverlayOptions::points);
  client::Pose pose;
  pose.hip_mm = pose.scp_h_mm = {1.0, 2.0, 3.0};
  const Overlay overlay = BuildOverlay({.pose = pose}, options, {}, kSize);
  EXPECT_EQ(WithColor(overlay, kHipColor).size(), overlay.solids.size());
  EXPECT_FALSE(overlay.solids.empty());
  EXPECT_TRUE(Lines(overlay, false).empty());
}

// The image's shorter side has the field of view, so both shapes are tried.
TEST(ViewOverlay, PointsKeepTheirSizeOnTheScreen) {
  const OverlayOptions options = Only(&OverlayOptions::points);
  const client::Pose pose = InContact();
  for (const ImageSize& size : {kSize, ImageSize{300, 900}, ImageSize{1600, 400}}) {
    for (const double zoom : {0.3, 1.0, 4.0, 40.0}) {
      Camera camera;
      camera.LookAt(pose.hip_mm);
      camera.Zoom(zoom);
      const Overlay overlay = BuildOverlay({.pose = pose}, options, camera, size);
      EXPECT_NEAR(Radius_px(WithColor(overlay, kHipColor), pose.hip_mm, camera, size),
                  kPointRadius_px, 0.3)
          << zoom;
    }
  }
}

TEST(ViewOverlay, TheArrowIsAlongTheForceAndAsLongAsItIsStrong) {
  const OverlayOptions options = Only(&OverlayOptions::force);
  Camera camera;
  camera.Set(Vec3::Zero(), 0.0, 0.0, 250.0);  // along -z: x and y are seen at full length
  for (const double force_n : {0.2, 1.0, 3.3}) {
    client::Pose pose = InContact();
    pose.scp_h_mm = Vec3::Zero();
    pose.force_n = force_n * Vec3(0.6, 0.8, 0.0);
    const Overlay overlay = BuildOverlay({.pose = pose}, options, camera, kSize);
    ASSERT_FALSE(overlay.solids.empty());
    ASSERT_EQ(WithColor(overlay, kForceColor).size(), overlay.solids.size());
    const Extent along = Along(overlay.solids, pose.scp_h_mm, Vec3(0.6, 0.8, 0.0));
    EXPECT_NEAR(along.least, 0.0, 1e-6);
    const Vec3 tip_D = along.greatest * Vec3(0.6, 0.8, 0.0);
    const double length_px =
        (OnScreen(tip_D, camera, kSize) - OnScreen(pose.scp_h_mm, camera, kSize)).norm();
    EXPECT_NEAR(length_px, kGreatestForce_px * force_n / 3.3, 1e-4) << force_n;
    // Thin across.
    const Extent across = Along(overlay.solids, pose.scp_h_mm, Vec3(0.8, -0.6, 0.0));
    EXPECT_LT((across.greatest - across.least) / along.greatest * length_px, 13.0);
    EXPECT_NEAR(across.greatest, -across.least, 1e-4);
  }
  client::Pose weak = InContact();
  for (const double force_n : {0.0, 1e-9}) {
    weak.force_n = {0.0, 0.0, force_n};
    EXPECT_TRUE(BuildOverlay({.pose = weak}, options, {}, kSize).solids.empty());
  }
}

// As it is felt, in place of the stylus; outlines where the hand wants it, if that is elsewhere.
TEST(ViewOverlay, ATouchingBallOfAToolHasTheProxysColour) {
  Camera camera;
  camera.Set(Vec3::Zero(), 0.0, 0.0, 250.0);
  client::Pose pose = InContact();
  pose.scp_h_mm = pose.hip_mm = Vec3::Zero();
  pose.stylus_orientation = Eigen::Quaterniond::Identity();
  pose.tool_orientation =
      Eigen::Quaterniond(Eigen::AngleAxisd(0.5 * std::numbers::pi, Vec3::UnitY()));
  pose.touching_balls = 1u << 1;
  OverlayScene scene{.pose = pose};
  scene.tool.ball = {{Vec3(0, 0, 5), 3.0}, {Vec3(0, 0, 20), 4.0}};
  const OverlayOptions options = Only(&OverlayOptions::stylus);
  const Overlay turned = BuildOverlay(scene, options, camera, kSize);
  const std::vector<SolidVertex> touching = WithColor(turned, kScpHColor);
  // z of the stylus has been turned to x.
  const Extent along = Along(touching, Vec3(20, 0, 0), Vec3::UnitX());
  EXPECT_NEAR(along.greatest, 4.0, 0.05);
  EXPECT_NEAR(along.least, -4.0, 0.05);
  EXPECT_GT(turned.solids.size(), touching.size());
  EXPECT_FALSE(turned.lines.empty());
  scene.pose->stylus_orientation = *pose.tool_orientation;
  EXPECT_TRUE(BuildOverlay(scene, options, camera, kSize).lines.empty());
}

TEST(ViewOverlay, TheArcIsAboutTheTorqueAndAsLongAsItIsStrong) {
  Camera camera;
  camera.Set(Vec3::Zero(), 0.0, 0.0, 250.0);
  client::Pose pose = InContact();
  pose.force_n = Vec3::Zero();
  pose.torque_n_mm = Vec3(0, 0, 40);
  const auto vertices = [&](double most_n_mm) {
    const OverlayScene scene{.pose = pose, .max_torque_n_mm = most_n_mm};
    return WithColor(BuildOverlay(scene, Only(&OverlayOptions::force), camera, kSize), kForceColor);
  };
  const Extent across = Along(vertices(40.0), pose.scp_h_mm, Vec3::UnitZ());
  const Extent along = Along(vertices(40.0), pose.scp_h_mm, Vec3::UnitX());
  EXPECT_LT(across.greatest - across.least, 0.25 * (along.greatest - along.least));
  EXPECT_GT(vertices(40.0).size(), 2 * vertices(100.0).size());
  EXPECT_TRUE(vertices(0.0).empty());
}

TEST(ViewOverlay, TheStylusHasItsTipAtHipAndPointsAlongItsMinusZ) {
  const OverlayOptions options = Only(&OverlayOptions::stylus);
  client::Pose pose = InContact();
  pose.stylus_orientation =
      Eigen::Quaterniond(Eigen::AngleAxisd(1.1, Vec3(1.0, -2.0, 0.5).normalized()));
  const Vec3 pointing = pose.stylus_orientation * -Vec3::UnitZ();
  const Overlay overlay = BuildOverlay({.pose = pose}, options, {}, kSize);
  ASSERT_FALSE(overlay.solids.empty());
  const Extent along = Along(overlay.solids, pose.hip_mm, pointing);
  EXPECT_NEAR(along.greatest, 0.0, 1e-5);
  EXPECT_LT(along.least, -50.0);
  for (const SolidVertex& vertex : overlay.solids) {
    const Vec3 from_tip = vertex.position_D.cast<double>() - pose.hip_mm;
    EXPECT_LT((from_tip - from_tip.dot(pointing) * pointing).norm(), 5.0);
  }
}

// Seen from outside, corners turn to the left: what is hidden is told by that.
TEST(ViewOverlay, BodiesFaceOutwards) {
  const Overlay overlay = BuildOverlay({.pose = InContact()}, {}, {}, kSize);
  ASSERT_EQ(overlay.solids.size() % 3, 0u);
  for (std::size_t n = 0; n < overlay.solids.size(); n += 3) {
    const SolidVertex &a = overlay.solids[n], &b = overlay.solids[n + 1],
                      &c = overlay.solids[n + 2];
    const Eigen::Vector3f turn = (b.position_D - a.position_D).cross(c.position_D - a.position_D);
    EXPECT_GT(turn.dot(a.normal + b.normal + c.normal), 0.0f) << n;
    for (const SolidVertex* vertex : {&a, &b, &c}) EXPECT_NEAR(vertex->normal.norm(), 1.0f, 1e-5f);
  }
}

TEST(ViewOverlay, TheBoxIsAroundTheOutermostVoxels) {
  const OverlayOptions options = Only(&OverlayOptions::box);
  OverlayScene scene;
  scene.X_DI = AffineMap{Mat3(Vec3(1.0, 2.0, 4.0).asDiagonal()), Vec3(10.0, 20.0, 30.0)};
  scene.lattice_size = {4, 5, 6};
  const Overlay overlay = BuildOverlay(scene, options, {}, kSize);
  ASSERT_EQ(overlay.lines.size(), 24u);
  double length_mm = 0.0;
  Eigen::Vector3f min = overlay.lines[0].position_D, max = min;
  for (std::size_t n = 0; n < 24; n += 2) {
    const Eigen::Vector3f edge = overlay.lines[n + 1].position_D - overlay.lines[n].position_D;
    EXPECT_EQ((edge.array() != 0.0f).count(), 1);
    length_mm += edge.norm();
    min = min.cwiseMin(overlay.lines[n].position_D);
    max = max.cwiseMax(overlay.lines[n + 1].position_D);
  }
  EXPECT_EQ(min, Eigen::Vector3f(9.5f, 19.0f, 28.0f));
  EXPECT_EQ(max, Eigen::Vector3f(13.5f, 29.0f, 52.0f));
  EXPECT_NEAR(length_mm, 4 * (4.0 + 10.0 + 24.0), 1e-4);
}

// The lines of a letter are near its face, and none is on the line of sight.
TEST(ViewOverlay, LettersAreBesideTheFacesOfThePatientsSides) {
  OverlayOptions options = Only(&OverlayOptions::box);
  OverlayScene scene;
  scene.lattice_size = {40, 40, 40};
  scene.X_DI = AffineMap{Mat3::Identity(), Vec3::Constant(-19.5)};
  // The letters' mean place, where there is one, on the side of each face: x, -x, y, ...
  const auto sides = [&] {
    std::array<int, 6> lines{};
    const Overlay overlay = BuildOverlay(scene, options, {}, kSize);
    for (std::size_t n = 24; n < overlay.lines.size(); n += 2) {
      const Eigen::Vector3f p = overlay.lines[n].position_D;
      int axis = 0;
      EXPECT_GT(p.cwiseAbs().maxCoeff(&axis), 20.0f);
      ++lines[static_cast<std::size_t>(2 * axis + (p[axis] < 0.0f ? 1 : 0))];
    }
    return lines;
  };
  EXPECT_EQ(sides(), (std::array<int, 6>{}));  // not known
  // L 2, R 7, P 6, A 3, S 11, I 3 lines; S and I are nearly on the line of sight.
  scene.P_from_I = Mat3::Identity();
  EXPECT_EQ(sides(), (std::array<int, 6>{2, 7, 6, 3, 0, 0}));
  // Right, anterior, superior as the voxels run; then superior, left, posterior.
  scene.P_from_I = Vec3(-1.0, -1.0, 1.0).asDiagonal();
  EXPECT_EQ(sides(), (std::array<int, 6>{7, 2, 3, 6, 0, 0}));
  scene.P_from_I->row(2) << 1.0, 0.0, 0.0;
  scene.P_from_I->row(0) << 0.0, 1.0, 0.0;
  scene.P_from_I->row(1) << 0.0, 0.0, 1.0;
  EXPECT_EQ(sides(), (std::array<int, 6>{11, 3, 2, 7, 0, 0}));
  options.letters = false;
  EXPECT_EQ(sides(), (std::array<int, 6>{}));
}

// What a line comes nearer to the eye is less than what V and H differ by, seen closely;
// before those lines come faint ones that a voxel of V does not hide.
TEST(ViewOverlay, TheWireframeOfHComesALittleNearerToTheEye) {
  const OverlayOptions options = Only(&OverlayOptions::haptic_surface);
  OverlayScene scene;
  scene.X_DI = AffineMap{0.5 * Mat3::Identity(), Vec3(1.0, 2.0, 3.0)};
  scene.haptic_lines_I = {{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 1.0, 1.0}};
  Camera camera;
  camera.LookAt(scene.X_DI->translation);
  for (const double zoom : {1.0, 10.0, 100.0}) {
    camera.Set(scene.X_DI->translation, 20.0, 15.0, 300.0 / zoom);
    const Overlay overlay = BuildOverlay(scene, options, camera, kSize);
    ASSERT_EQ(overlay.lines.size(), 8u);
    for (std::size_t n = 0; n < 8; ++n) {
      const Vec3 p_D = scene.X_DI->Apply(scene.haptic_lines_I[n % 4]);
      const Vec3 moved_mm = overlay.lines[n].position_D.cast<double>() - p_D;
      const Vec3 to_eye = camera.Eye() - p_D;
      EXPECT_GT(moved_mm.dot(to_eye), 0.0);
      EXPECT_LT(moved_mm.cross(to_eye).norm() / to_eye.norm(), 1e-5);
      EXPECT_LT((OnScreen(overlay.lines[n].position_D.cast<double>(), camera, kSize) -
                 OnScreen(p_D, camera, kSize))
                    .norm(),
                0.02);
      if (zoom == 100.0) {
        EXPECT_LT(moved_mm.norm(), (n < 4 ? 0.8 : 0.03) * 0.5);  // voxels of 0.5 mm
      }
      if (n < 4) {
        EXPECT_LT(2 * overlay.lines[n].rgba[3], overlay.lines[n + 4].rgba[3]);
      }
    }
  }
}

TEST(ViewOverlay, AnEmptyImageOrAnEyeAtThePointGivesFiniteBodies) {
  client::Pose pose = InContact();
  Camera camera;
  pose.hip_mm = camera.Eye();
  pose.scp_h_mm = camera.Eye() + 10.0 * (camera.Eye() - camera.target()).normalized();
  for (const ImageSize& size : {ImageSize{}, kSize}) {
    const Overlay overlay = BuildOverlay({.pose = pose}, {}, camera, size);
    for (const SolidVertex& vertex : overlay.solids) {
      ASSERT_TRUE(vertex.position_D.allFinite() && vertex.normal.allFinite());
    }
  }
}

}  // namespace

namespace {

TEST(BrushBall, EveryPointOfItsOutlineTouchesTheBall) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-50.0, 50.0);
  for (int trial = 0; trial < 100; ++trial) {
    const Vec3 center_D(place(random), place(random), place(random));
    const double radius_mm = 0.1 + 0.1 * std::abs(place(random));
    Camera camera;
    camera.Set(Vec3::Zero(), 7.0 * place(random), place(random), 250.0);
    const Vec3 eye_D = camera.Eye();
    const auto outline = OutlineOf(center_D, radius_mm, eye_D);
    ASSERT_TRUE(outline);
    for (int n = 0; n < 16; ++n) {
      const Vec3 across = outline->axis.unitOrthogonal();
      const Vec3 out = Eigen::AngleAxisd(0.4 * n, outline->axis) * across;
      const Vec3 p_D = outline->center_D + outline->radius_mm * out;
      // On the ball, and the sight is a tangent there.
      EXPECT_NEAR((p_D - center_D).norm(), radius_mm, 1e-9);
      EXPECT_NEAR((p_D - center_D).dot(eye_D - p_D), 0.0, 1e-6);
    }
  }
}

TEST(BrushBall, IsNotDrawnAroundTheEye) {
  EXPECT_FALSE(OutlineOf(Vec3::Zero(), 5.0, Vec3(0, 0, 4.9)));
  Overlay overlay;
  Camera camera;
  AddBrushBall(camera.Eye(), 3.0, 1.0, Projection(camera, {800, 600}), overlay);
  EXPECT_TRUE(overlay.solids.empty() && overlay.lines.empty());
}

// A second outline, only where the brush fades.
TEST(BrushBall, ShowsWhereTheFadeEnds) {
  const Projection projection(Camera{}, {800, 600});
  const auto lines = [&](double fade_mm) {
    Overlay overlay;
    AddBrushBall(Vec3::Zero(), 3.0, fade_mm, projection, overlay);
    double farthest_mm = 0.0;
    for (const LineVertex& vertex : overlay.lines) {
      EXPECT_GT(vertex.alpha_behind, 0);
      EXPECT_LT(vertex.alpha_behind, vertex.rgba[3]);
      farthest_mm = std::max(farthest_mm, vertex.position_D.cast<double>().norm());
    }
    return std::pair(overlay.lines.size(), farthest_mm);
  };
  const auto [one, radius_mm] = lines(0.0);
  const auto [two, with_fade_mm] = lines(2.0);
  EXPECT_EQ(two, 2 * one);
  EXPECT_NEAR(radius_mm, 3.0, 0.3);
  EXPECT_NEAR(with_fade_mm, 5.0, 0.3);
}

}  // namespace

}  // namespace palpate::view
