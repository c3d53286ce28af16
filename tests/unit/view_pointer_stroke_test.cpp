// The brush under the pointer, on a surface of which every depth is known.
#include "client/view/app/pointer_stroke.h"

#include <gtest/gtest.h>

#include <limits>

namespace palpate::view {
namespace {

using Eigen::Vector2d;

constexpr ImageSize kView{800, 600};
constexpr double kJump_mm = 6.0;
constexpr float kNoDistance = std::numeric_limits<float>::infinity();

// What a brush gets: points of D, and a gap where it was lifted.
struct Drawn {
  std::vector<std::optional<Vec3>> points;

  PointerStroke::Sink sink() {
    return {.draw = [this](const Vec3& p_D) { points.push_back(p_D); },
            .lift = [this] { points.push_back({}); }};
  }
  int gaps() const {
    int count = 0;
    for (const auto& point : points) count += !point;
    return count;
  }
};

// A wall that faces the eye, with `distances(x)` in each column; x in tens of pixels.
template <typename Distances>
SeenSurface Wall(const Distances& distances) {
  SeenSurface surface{.size = kView, .camera = {}, .distances_mm = {}};
  for (int y = 0; y < kView.height; ++y) {
    for (int x = 0; x < kView.width; ++x) surface.distances_mm.push_back(distances(0.1 * x));
  }
  return surface;
}

TEST(PointerStroke, BeginsOnTheSurfaceOnly) {
  PointerStroke stroke;
  Drawn drawn;
  const SeenSurface wall = Wall([](double x) { return x < 40 ? 300.0f : kNoDistance; });
  EXPECT_FALSE(stroke.Begin(wall, Vector2d(500, 300), kView, kJump_mm, drawn.sink()));
  EXPECT_FALSE(stroke.Begin(wall, Vector2d(-1, 300.0), kView, kJump_mm, drawn.sink()));
  EXPECT_FALSE(stroke.Begin({}, Vector2d(500, 300), kView, kJump_mm, drawn.sink()));
  EXPECT_FALSE(stroke.has_pointer());
  EXPECT_TRUE(drawn.points.empty());
  EXPECT_TRUE(stroke.Begin(wall, Vector2d(205.5, 305.5), kView, kJump_mm, drawn.sink()));
  EXPECT_TRUE(stroke.has_pointer());
  ASSERT_EQ(drawn.points.size(), 1u);
  const Ray ray = wall.camera.RayThrough(205.5, 305.5, kView);
  EXPECT_NEAR((*drawn.points[0] - (ray.origin + 300.0 * ray.direction)).norm(), 0.0, 1e-4);
}

TEST(PointerStroke, APointerAtRestDrawsNothingMore) {
  PointerStroke stroke;
  Drawn drawn;
  ASSERT_TRUE(stroke.Begin(Wall([](double) { return 300.0f; }), Vector2d(200, 300), kView, kJump_mm,
                           drawn.sink()));
  for (int n = 0; n < 100; ++n) stroke.MoveTo(Vector2d(200, 300), kView, drawn.sink());
  EXPECT_EQ(drawn.points.size(), 1u);
}

// However far the pointer gets from one frame to the next.
TEST(PointerStroke, FollowsTheSurfaceBetweenTheFrames) {
  PointerStroke stroke;
  Drawn drawn;
  const SeenSurface ridge =
      Wall([](double x) { return 300.0f + static_cast<float>(std::abs(x - 40)); });
  ASSERT_TRUE(stroke.Begin(ridge, Vector2d(100, 300), kView, kJump_mm, drawn.sink()));
  stroke.MoveTo(Vector2d(700, 300), kView, drawn.sink());
  EXPECT_GE(drawn.points.size(), 300u);
  EXPECT_EQ(drawn.gaps(), 0);
  double nearest_mm = 1e9;
  for (const auto& point : drawn.points) {
    nearest_mm = std::min(nearest_mm, (*point - ridge.camera.Eye()).norm());
  }
  EXPECT_LE(nearest_mm, 302.0);
}

TEST(PointerStroke, IsLiftedBesideTheSurfaceAndWhereItJumps) {
  for (const float beyond : {kNoDistance, 300.0f + 2.0f * static_cast<float>(kJump_mm), 280.0f}) {
    PointerStroke stroke;
    Drawn drawn;
    const SeenSurface surface =
        Wall([beyond](double x) { return x >= 30 && x < 50 ? beyond : 300.0f; });
    ASSERT_TRUE(stroke.Begin(surface, Vector2d(100, 300), kView, kJump_mm, drawn.sink()));
    stroke.MoveTo(Vector2d(700, 300), kView, drawn.sink());
    EXPECT_EQ(drawn.gaps(), beyond == kNoDistance ? 1 : 2);
    // Between gaps neighbours are near each other.
    for (std::size_t n = 1; n < drawn.points.size(); ++n) {
      if (!drawn.points[n] || !drawn.points[n - 1]) continue;
      EXPECT_LT((*drawn.points[n] - *drawn.points[n - 1]).norm(), 2.0 * kJump_mm);
    }
  }
}

TEST(PointerStroke, ASlopeIsNoJump) {
  PointerStroke stroke;
  Drawn drawn;
  const SeenSurface slope = Wall([](double x) { return 300.0f + 6.0f * static_cast<float>(x); });
  ASSERT_TRUE(stroke.Begin(slope, Vector2d(50, 300), kView, kJump_mm, drawn.sink()));
  stroke.MoveTo(Vector2d(750, 300), kView, drawn.sink());
  EXPECT_EQ(drawn.gaps(), 0);
}

TEST(PointerStroke, KeepsThePointerAfterItWasBrokenOff) {
  PointerStroke stroke;
  Drawn drawn;
  ASSERT_TRUE(stroke.Begin(Wall([](double) { return 300.0f; }), Vector2d(200, 300), kView, kJump_mm,
                           drawn.sink()));
  stroke.BreakOff();
  stroke.MoveTo(Vector2d(600, 300), kView, drawn.sink());
  EXPECT_EQ(drawn.points.size(), 1u);
  EXPECT_TRUE(stroke.has_pointer());
  stroke.Release();
  EXPECT_FALSE(stroke.has_pointer());
}

// A picture of fewer pixels than the view has, as while things move.
TEST(PointerStroke, KnowsThePlaceInACoarsePicture) {
  const SeenSurface wall = Wall([](double) { return 300.0f; });
  const ImageSize view{1600, 1200};
  const Vec3 p_D = *wall.At(Vector2d(1200, 400), view);
  const Ray ray = wall.camera.RayThrough(1200, 400, view);
  EXPECT_LT((p_D - (ray.origin + 300.0 * ray.direction)).norm(), 4.0);
  EXPECT_FALSE(wall.At(Vector2d(1610, 400), view));
}

}  // namespace
}  // namespace palpate::view
