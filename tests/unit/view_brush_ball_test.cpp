// The outline of the brush is that of a ball in perspective.
#include "client/view/drawing/brush_ball.h"

#include <gtest/gtest.h>

#include <random>

namespace palpate::view {
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
