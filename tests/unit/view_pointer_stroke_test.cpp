// The brush under the pointer, on a surface of which every depth is known.
#include "client/view/viewer/pointer_stroke.h"

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

class PointerStrokeTest : public ::testing::Test {
 protected:
  bool Begin(const SeenSurface& surface, double x, double y = 300.0) {
    return stroke_.Begin(surface, Vector2d(x, y), kView, kJump_mm, drawn_.sink());
  }
  void MoveTo(double x) { stroke_.MoveTo(Vector2d(x, 300), kView, drawn_.sink()); }

  PointerStroke stroke_;
  Drawn drawn_;
  const SeenSurface flat_ = Wall([](double) { return 300.0f; });
};

TEST_F(PointerStrokeTest, BeginsOnTheSurfaceOnly) {
  const SeenSurface wall = Wall([](double x) { return x < 40 ? 300.0f : kNoDistance; });
  EXPECT_FALSE(Begin(wall, 500));
  EXPECT_FALSE(Begin(wall, -1));
  EXPECT_FALSE(Begin({}, 500));
  EXPECT_FALSE(stroke_.has_pointer());
  EXPECT_TRUE(drawn_.points.empty());
  EXPECT_TRUE(Begin(wall, 205.5, 305.5));
  EXPECT_TRUE(stroke_.has_pointer());
  ASSERT_EQ(drawn_.points.size(), 1u);
  const Ray ray = wall.camera.RayThrough(205.5, 305.5, kView);
  EXPECT_NEAR((*drawn_.points[0] - (ray.origin + 300.0 * ray.direction)).norm(), 0.0, 1e-4);
}

// However far the pointer gets from one frame to the next.
TEST_F(PointerStrokeTest, FollowsTheSurfaceBetweenTheFrames) {
  const SeenSurface ridge =
      Wall([](double x) { return 300.0f + static_cast<float>(std::abs(x - 40)); });
  ASSERT_TRUE(Begin(ridge, 100));
  MoveTo(700);
  EXPECT_GE(drawn_.points.size(), 300u);
  EXPECT_EQ(drawn_.gaps(), 0);
  double nearest_mm = 1e9;
  for (const auto& point : drawn_.points) {
    nearest_mm = std::min(nearest_mm, (*point - ridge.camera.Eye()).norm());
  }
  EXPECT_LE(nearest_mm, 302.0);
}

TEST_F(PointerStrokeTest, DrawsTheSamePointsHoweverOftenThePointerIsSampled) {
  const SeenSurface ridge =
      Wall([](double x) { return 300.0f + static_cast<float>(std::abs(x - 40)); });
  std::vector<std::optional<Vec3>> first;
  for (const int samples : {1, 2, 7, 99, 600}) {
    stroke_ = {};
    drawn_ = {};
    ASSERT_TRUE(Begin(ridge, 100.5));
    for (int n = 1; n <= samples; ++n) MoveTo(100.5 + std::round(600.0 * n / samples));
    if (first.empty()) first = drawn_.points;
    ASSERT_EQ(drawn_.points.size(), first.size()) << samples;
    for (std::size_t n = 0; n < first.size(); ++n) {
      EXPECT_LT((*drawn_.points[n] - *first[n]).norm(), 1e-9) << samples << " " << n;
    }
  }
}

TEST_F(PointerStrokeTest, IsLiftedBesideTheSurfaceAndWhereItJumps) {
  for (const float beyond : {kNoDistance, 300.0f + 2.0f * static_cast<float>(kJump_mm), 280.0f}) {
    stroke_ = {};
    drawn_ = {};
    ASSERT_TRUE(
        Begin(Wall([beyond](double x) { return x >= 30 && x < 50 ? beyond : 300.0f; }), 100));
    MoveTo(700);
    EXPECT_EQ(drawn_.gaps(), beyond == kNoDistance ? 1 : 2);
    // Between gaps neighbours are near each other.
    for (std::size_t n = 1; n < drawn_.points.size(); ++n) {
      if (!drawn_.points[n] || !drawn_.points[n - 1]) continue;
      EXPECT_LT((*drawn_.points[n] - *drawn_.points[n - 1]).norm(), 2.0 * kJump_mm);
    }
  }
}

TEST_F(PointerStrokeTest, ASlopeIsNoJump) {
  ASSERT_TRUE(Begin(Wall([](double x) { return 300.0f + 6.0f * static_cast<float>(x); }), 50));
  MoveTo(750);
  EXPECT_EQ(drawn_.gaps(), 0);
}

TEST_F(PointerStrokeTest, DrawsNothingAtRestAndKeepsThePointerAfterItWasBrokenOff) {
  ASSERT_TRUE(Begin(flat_, 200));
  for (int n = 0; n < 100; ++n) MoveTo(200);
  EXPECT_EQ(drawn_.points.size(), 1u);
  stroke_.BreakOff();
  MoveTo(600);
  EXPECT_EQ(drawn_.points.size(), 1u);
  EXPECT_TRUE(stroke_.has_pointer());
  stroke_.Release();
  EXPECT_FALSE(stroke_.has_pointer());
}

// A picture of fewer pixels than the view has, as while things move.
TEST_F(PointerStrokeTest, KnowsThePlaceInACoarsePicture) {
  const ImageSize view{1600, 1200};
  const Vec3 p_D = *flat_.At(Vector2d(1200, 400), view);
  const Ray ray = flat_.camera.RayThrough(1200, 400, view);
  EXPECT_LT((p_D - (ray.origin + 300.0 * ray.direction)).norm(), 4.0);
  EXPECT_FALSE(flat_.At(Vector2d(1610, 400), view));
}

}  // namespace
}  // namespace palpate::view
