// The pointer: the brush under it, on a surface of which every depth is known; and where it leads
// the hand.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "client/view/viewer/pointer.h"

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

constexpr ImageSize kAimView = {400, 300};
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Camera Looking() {
  Camera camera;
  camera.Set({3.0, -4.0, 5.0}, 35.0, 20.0, 250.0);
  return camera;
}

// A wall at a distance from the eye in the left half of the picture, nothing in the right half.
SeenSurface HalfAWall(double distance_mm, const ImageSize& size = kAimView) {
  SeenSurface seen{.size = size, .camera = Looking(), .distances_mm = {}};
  for (int n = 0; n < size.width * size.height; ++n) {
    seen.distances_mm.push_back(
        static_cast<float>(n % size.width < size.width / 2 ? distance_mm : kInfinity));
  }
  return seen;
}

double Depth_mm(const Vec3& p_D, const Camera& camera) { return -camera.X_VD().Apply(p_D).z(); }

// Distance from the line of sight through a point of the view.
double Beside_mm(const Vec3& p_D, const Camera& camera, const Eigen::Vector2d& at_px) {
  const Ray ray = camera.RayThrough(at_px.x(), at_px.y(), kAimView);
  return (p_D - ray.origin).cross(ray.direction).norm();
}

TEST(ViewHandAim, AlongTheSurfaceTheTargetIsBehindWhatIsUnderThePointer) {
  const Eigen::Vector2d at_px = {100.5, 90.5};
  for (const double press_mm : {-5.0, 0.0, 3.0}) {
    for (const double harder_mm : {0.0, 4.0}) {
      HandAim aim;
      aim.Begin(Vec3::Zero());
      for (const double tip_mm : {0.0, 2.5}) {
        aim.Follow(at_px, kAimView, HalfAWall(200.0), {.press_mm = press_mm}, tip_mm);
        aim.PressHarder(harder_mm);
        EXPECT_NEAR((aim.target_D() - Looking().Eye()).norm(),
                    200.0 + press_mm + harder_mm - tip_mm, 1e-4);
      }
      EXPECT_LT(Beside_mm(aim.target_D(), Looking(), at_px), 1e-9);
    }
  }
}

// Pictures have fewer pixels than the view while things move.
TEST(ViewHandAim, ACoarsePictureLeadsToThePointerToo) {
  HandAim aim;
  aim.Begin(Vec3::Zero());
  const Eigen::Vector2d at_px = {101.0, 91.0};
  aim.Follow(at_px, kAimView, HalfAWall(200.0, {200, 150}), {.press_mm = 0.0}, 0.0);
  EXPECT_NEAR((aim.target_D() - Looking().Eye()).norm(), 200.0, 1e-4);
  EXPECT_LT(Beside_mm(aim.target_D(), Looking(), at_px), 1.0);
}

TEST(ViewHandAim, BesideTheSurfaceTheHandStaysInThePlaneOfItsLastPlace) {
  const SeenSurface seen = HalfAWall(200.0);
  HandAim aim;
  aim.Begin(Vec3::Zero());
  aim.Follow({199.5, 150.0}, kAimView, seen, {.press_mm = 3.0}, 0.0);
  const double depth_mm = Depth_mm(aim.target_D(), seen.camera);
  for (const Eigen::Vector2d& at_px : {Eigen::Vector2d{210.0, 150.0}, {390.0, 10.0}}) {
    aim.Follow(at_px, kAimView, seen, {.press_mm = 3.0}, 0.0);
    EXPECT_NEAR(Depth_mm(aim.target_D(), seen.camera), depth_mm, 1e-9);
    EXPECT_LT(Beside_mm(aim.target_D(), seen.camera, at_px), 1e-9);
  }
}

TEST(ViewHandAim, InThePlaneTheHandKeepsItsDepthUntilItIsPushed) {
  const SeenSurface seen = HalfAWall(200.0);
  const HandOptions plane{.way = HandWay::kPlane};
  HandAim aim;
  aim.Begin(seen.camera.target());
  for (const Eigen::Vector2d& at_px : {Eigen::Vector2d{100.0, 90.0}, {390.0, 290.0}}) {
    aim.Follow(at_px, kAimView, seen, plane, 0.0);
    EXPECT_NEAR(Depth_mm(aim.target_D(), seen.camera), 250.0, 1e-9);
    EXPECT_LT(Beside_mm(aim.target_D(), seen.camera, at_px), 1e-9);
  }
  aim.Push(7.0, seen.camera);
  aim.Follow({200.0, 150.0}, kAimView, seen, plane, 0.0);
  EXPECT_NEAR(Depth_mm(aim.target_D(), seen.camera), 257.0, 1e-9);
  // Harder for a moment: then it is back.
  aim.PressHarder(4.0);
  EXPECT_NEAR(Depth_mm(aim.target_D(), seen.camera), 261.0, 1e-9);
  aim.PressHarder(0.0);
  EXPECT_NEAR(Depth_mm(aim.target_D(), seen.camera), 257.0, 1e-9);
}

TEST(ViewHandAim, ThePressIsBounded) {
  HandOptions options;
  options.Press(1000.0);
  EXPECT_EQ(options.press_mm, HandOptions::kMostPress_mm);
  options.Press(-1000.0);
  EXPECT_EQ(options.press_mm, HandOptions::kLeastPress_mm);
}

// Not through the volume: out, around, and in along the line of sight.
TEST(ViewHandAim, TheWayToAnotherSideIsAroundTheVolume) {
  std::mt19937 random(43);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  const auto direction = [&] { return Vec3(any(random), any(random), any(random)).normalized(); };
  const Surroundings volume{.center_D = {5.0, -3.0, 2.0}, .radius_mm = 50.0};
  for (int n = 0; n < 500; ++n) {
    const Vec3 from_D = volume.center_D + 30.0 * direction();
    const Vec3 eye_D = volume.center_D + 200.0 * direction();
    // On the side of a ball that is seen, so that nothing is before it; sometimes opposite.
    const Vec3 to_eye = (eye_D - volume.center_D).normalized();
    const Vec3 out = n % 7 == 0 ? Vec3(to_eye) : Vec3((to_eye + 0.6 * direction()).normalized());
    const Vec3 target_D = volume.center_D + 30.0 * out;
    std::vector<Vec3> way_D = WayAround(from_D, target_D, eye_D, volume);
    ASSERT_EQ(way_D.back(), target_D);
    Vec3 at_D = from_D;
    double gone_mm = 0.0;
    while (!way_D.empty()) {
      const Vec3 next_D = GoAlong(way_D, at_D, 2.0);
      ASSERT_LE((next_D - at_D).norm(), 2.0 + 1e-9);
      ASSERT_GT((next_D - volume.center_D).norm(), 30.0 - 1e-6);
      at_D = next_D;
      gone_mm += 2.0;
      ASSERT_LT(gone_mm, 600.0);
    }
    EXPECT_LT((at_D - target_D).norm(), 1e-9);
  }
}

// A camera that has come past the hand, a view without pixels: the target is always a place.
TEST(ViewHandAim, EveryPointerGivesAFinitePlaceBeforeTheEye) {
  std::mt19937 random(42);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (int n = 0; n < 2000; ++n) {
    SeenSurface seen = HalfAWall(n % 3 == 0 ? kInfinity : 200.0, {8, 6});
    seen.camera.Set(60.0 * Vec3(any(random), any(random), any(random)), 180.0 * any(random),
                    89.0 * any(random), 1.0 + 100.0 * std::abs(any(random)));
    HandAim aim;
    aim.Begin(60.0 * Vec3(any(random), any(random), any(random)));
    const HandOptions options{.way = n % 2 == 0 ? HandWay::kPlane : HandWay::kSurface};
    const Eigen::Vector2d at_px = {200.0 + 300.0 * any(random), 150.0 + 300.0 * any(random)};
    aim.Follow(at_px, kAimView, seen, options, 0.0);
    ASSERT_TRUE(aim.target_D().allFinite());
    ASSERT_GT(Depth_mm(aim.target_D(), seen.camera), 0.0);
  }
}

}  // namespace

}  // namespace palpate::view
