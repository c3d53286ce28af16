// What a ball at the tip feels: surfaces whose distance from the ball's centre is known.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <vector>

#include "server/felt/felt_surface.h"
#include "server/haptics/renderer.h"
#include "server/pump/pose_of.h"
#include "server/safety/safety.h"
#include "tests/support/made_volume.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

constexpr double kBallTickS = 1e-3;
constexpr double kSphereMm = 14.0, kRampMm = 8.0;

// Where |x - centre| is the isosurface's radius at every isovalue, in mm of the device.
double SphereRadiusAt(double isovalue) { return kSphereMm - (isovalue - 0.5) * kRampMm; }

struct Sphere {
  AffineMap X_DI;
  Vec3 centre_mm;
  std::shared_ptr<const VolumeSnapshot> volume;

  // `axes`: mm per voxel. A hollow one is dense outside.
  explicit Sphere(const Mat3& axes, bool is_hollow = false, double room_mm = 24.0) {
    const Vec3 half = (2.0 * room_mm * axes.inverse().rowwise().norm()).array() / 2.0;
    const Vec3i size = (2.0 * half).array().ceil().cast<int>();
    X_DI = {axes, Vec3(3.0, -7.0, 11.0)};
    centre_mm = X_DI.Apply(0.5 * (size.cast<double>() - Vec3::Ones()) + Vec3(0.3, 0.1, 0.2));
    volume = testing::MakeVolume(size, [&](int i, int j, int k) {
      const double d = kSphereMm - (X_DI.Apply(Vec3(i, j, k)) - centre_mm).norm();
      return std::clamp(0.5 + (is_hollow ? -d : d) / kRampMm, 0.0, 1.0);
    });
  }
};

Scene SceneOf(const Sphere& sphere, const std::optional<FeltBall>& ball, double isovalue,
              std::uint64_t revision = 1) {
  Scene scene;
  scene.volume = sphere.volume;
  scene.settings.refinement = 1;
  if (ball) scene.settings.free_side = ball->side();
  FeltTip tip;
  if (ball) tip.fields.push_back(*ball);
  FeelSurface(sphere.X_DI, isovalue, revision, tip, scene);
  return scene;
}

FeltBall BallOn(const Sphere& sphere, double radius_mm, bool is_least = false) {
  return FeltBall({radius_mm, sphere.X_DI.linear, is_least}, *sphere.volume);
}

struct Errors {
  double sum2 = 0.0, worst = 0.0;
  int count = 0;
  void Add(double voxels) {
    sum2 += voxels * voxels;
    worst = std::max(worst, std::abs(voxels));
    ++count;
  }
  double rms() const { return std::sqrt(sum2 / count); }
};

// The stylus presses from `far_mm` to `near_mm` from the centre, in random directions.
void Touch(const Scene& scene, const Vec3& centre_mm, double far_mm, double near_mm, int count,
           const std::function<void(const ProxyStep&)>& take) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const auto state = std::make_unique<RendererState>();
  for (int n = 0; n < count; ++n) {
    const Vec3 direction = Vec3(normal(random), normal(random), normal(random)).normalized();
    *state = RendererState();
    StepRenderer(scene.surface, scene.settings, centre_mm + far_mm * direction, kBallTickS, *state);
    ProxyStep step;
    for (int ticks = 0; ticks < 3; ++ticks) {
      step = StepRenderer(scene.surface, scene.settings, centre_mm + near_mm * direction,
                          kBallTickS, *state)
                 .proxy;
    }
    ASSERT_EQ(step.mode, ProxyMode::kConstrained);
    take(step);
  }
}

// The centre stays as far from the isosurface as the ball is large: at every isovalue of one field.
TEST(FeltBall, AnySphereIsFeltLargerByTheBall) {
  Mat3 sheared;
  sheared << 1.0, 0.3, 0.0, 0.0, -0.9, 0.1, 0.2, 0.0, 1.2;  // and mirrored
  const Mat3 flat = Vec3(1.0, 1.0, 2.5).asDiagonal();
  for (const Mat3& axes : {Mat3(Mat3::Identity()), sheared, flat}) {
    const double voxel_mm = axes.colwise().norm().minCoeff();
    const bool is_flat = axes == flat;
    const Sphere sphere(axes);
    for (const double voxels : {0.3, 0.5, 1.0, 2.0, 4.0, 8.0}) {
      const double radius_mm = voxels * voxel_mm;
      const FeltBall ball = BallOn(sphere, radius_mm);
      Errors errors;
      for (const double isovalue : {0.3, 0.4, 0.5, 0.6, 0.7}) {
        const double felt_mm = SphereRadiusAt(isovalue) + radius_mm;
        Touch(SceneOf(sphere, ball, isovalue), sphere.centre_mm, felt_mm + 3.0, felt_mm - 1.0, 60,
              [&](const ProxyStep& step) {
                errors.Add(((step.p_DH_mm - sphere.centre_mm).norm() - felt_mm) / voxel_mm);
              });
      }
      std::printf("%s, r %.1f voxels: rms %.3f, worst %.3f\n", is_flat ? "flat" : "even", voxels,
                  errors.rms(), errors.worst);
      const double least = is_flat ? 1.5 : 1.0;  // its slices are 2.5 voxels thick
      EXPECT_LE(errors.rms(), least * (voxels >= 2.0 ? 0.06 : 0.1));
      EXPECT_LE(errors.worst, least * (voxels >= 2.0 ? 0.15 : 0.25));
    }
  }
}

TEST(FeltBall, FromAboveAHollowIsFeltSmaller) {
  const Sphere sphere(Mat3::Identity(), true);
  for (const double radius_mm : {1.0, 4.0}) {
    const FeltBall ball = BallOn(sphere, radius_mm);
    Errors errors;
    Touch(SceneOf(sphere, ball, 0.5), sphere.centre_mm, 0.0, kSphereMm, 100,
          [&](const ProxyStep& step) {
            errors.Add((step.p_DH_mm - sphere.centre_mm).norm() - (kSphereMm - radius_mm));
          });
    EXPECT_LE(errors.worst, 0.2);
    // The same from the other side of the values: free where they are high.
    const Sphere dense(Mat3::Identity());
    const FeltBall eroded = BallOn(dense, radius_mm, true);
    Errors above;
    Touch(SceneOf(dense, eroded, 0.5), dense.centre_mm, 0.0, kSphereMm, 100,
          [&](const ProxyStep& step) {
            above.Add((step.p_DH_mm - dense.centre_mm).norm() - (kSphereMm - radius_mm));
          });
    EXPECT_LE(above.worst, 0.2);
  }
}

// Material up to the border is felt as if it ended there.
TEST(FeltBall, StopsBeforeTheBorder) {
  Sphere sphere(Mat3::Identity());
  sphere.volume = testing::MakeVolume(
      Vec3i(20, 20, 20), [](int i, int j, int k) { return i + j + k == 0 ? 0.0 : 1.0; });
  const FeltBall ball = BallOn(sphere, 4.0);
  const Scene scene = SceneOf(sphere, ball, 0.5);
  const auto state = std::make_unique<RendererState>();
  const Vec3 outside = sphere.X_DI.Apply(Vec3(-9.0, 10.2, 9.7));
  StepRenderer(scene.surface, scene.settings, outside, kBallTickS, *state);
  const ProxyStep step = StepRenderer(scene.surface, scene.settings,
                                      sphere.X_DI.Apply(Vec3(3.0, 10.2, 9.7)), kBallTickS, *state)
                             .proxy;
  // The cap is half a voxel before the first value.
  EXPECT_NEAR((scene.X_DI().Inverse().Apply(step.p_DH_mm)).x(), -4.5, 0.15);
}

// Its passages are 12 voxels wide.
TEST(FeltBall, OnAGyroidItTouchesWhereItStops) {
  Sphere sphere(Mat3::Identity());
  sphere.volume = testing::Gyroid(48);
  for (const double radius_mm : {1.0, 2.0, 3.0}) {
    const FeltBall ball = BallOn(sphere, radius_mm);
    const Scene scene = SceneOf(sphere, ball, 0.5);
    HapticSurface own =
        MakeHapticSurface(*sphere.volume, sphere.X_DI, 0.5, DecompositionMethod::kTpbcc, 1);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform;
    const auto state = std::make_unique<RendererState>();
    Vec3 hip_I = Vec3::Constant(-8.0);
    Errors errors;
    double sum = 0.0;
    for (int n = 0; n < 4000; ++n) {
      for (int axis = 0; axis < 3; ++axis) hip_I[axis] += 0.6 * (uniform(random) - 0.5);
      if (n % 400 == 0) hip_I = 48.0 * Vec3(uniform(random), uniform(random), uniform(random));
      const ProxyStep step =
          StepRenderer(scene.surface, scene.settings, sphere.X_DI.Apply(hip_I), kBallTickS, *state)
              .proxy;
      if (step.mode != ProxyMode::kConstrained) continue;
      const VisualProxy touched = FindTouchedPoint(own, step.p_DH_mm, radius_mm);
      ASSERT_TRUE(touched.found);
      // Beyond the lattice, V falls off within a voxel.
      const Vec3 touched_I = sphere.X_DI.Inverse().Apply(touched.p_DV_mm);
      if ((touched_I.array() < 0.0).any() || (touched_I.array() > 47.0).any()) continue;
      const double error = (touched.p_DV_mm - step.p_DH_mm).norm() - radius_mm;
      errors.Add(error);
      sum += error;
    }
    std::printf("gyroid, r %.0f: %d touches, rms %.3f, worst %.3f, mean %.3f\n", radius_mm,
                errors.count, errors.rms(), errors.worst, sum / errors.count);
    ASSERT_GT(errors.count, 1000);
    EXPECT_LE(errors.worst, 0.5);
    EXPECT_LE(std::abs(sum / errors.count), 0.05);
  }
}

// The values of a volume in bytes are often the isovalue itself.
TEST(FeltBall, TouchesVAtEveryValueOfAVolumeInBytes) {
  Sphere sphere(Mat3::Identity());
  sphere.volume = testing::MakeVolume(sphere.volume->size(), [&](int i, int j, int k) {
    return std::round(255.0 * testing::ValueAt(*sphere.volume, Vec3i(i, j, k)));
  });
  const double radius_mm = 2.0;
  const FeltBall ball = BallOn(sphere, radius_mm);
  for (const double value : {100.0, 128.0}) {
    const double isovalue = value / 255.0, felt_mm = SphereRadiusAt(isovalue) + radius_mm;
    const HapticSurface own =
        MakeHapticSurface(*sphere.volume, sphere.X_DI, isovalue, DecompositionMethod::kTpbcc, 1);
    Touch(SceneOf(sphere, ball, isovalue), sphere.centre_mm, felt_mm + 3.0, felt_mm - 1.0, 200,
          [&](const ProxyStep& step) {
            EXPECT_NEAR((step.p_DH_mm - sphere.centre_mm).norm(), felt_mm, 0.2);
            const VisualProxy touched = FindTouchedPoint(own, step.p_DH_mm, radius_mm);
            ASSERT_TRUE(touched.found);
            const Vec3 p_I = sphere.X_DI.Inverse().Apply(touched.p_DV_mm);
            const Vec3i cell = p_I.array().floor().cast<int>();
            const Trilinear f(sphere.volume->StoredCell(cell));
            EXPECT_NEAR(f.Value(p_I - cell.cast<double>()), isovalue, 1e-6);
            EXPECT_NEAR((touched.p_DV_mm - step.p_DH_mm).norm(), radius_mm, 0.2);
            EXPECT_GT(touched.normal_D.dot((step.p_DH_mm - touched.p_DV_mm).normalized()), 0.98);
          });
  }
}

// The ball grows under a stylus that presses: it is lifted as by an edit, and the force changes
// as slowly.
TEST(FeltBall, AnotherRadiusUnderLoadEndsSoonAndWithinTheSlew) {
  const Sphere sphere(Mat3::Identity());
  std::vector<std::optional<FeltBall>> balls = {
      std::nullopt, BallOn(sphere, 1.0), BallOn(sphere, 4.0), BallOn(sphere, 2.0), std::nullopt};
  const auto state = std::make_unique<RendererState>();
  Safety safety{SafetyLimits{}};
  Vec3 force_n = Vec3::Zero(), last_n = Vec3::Zero();
  double step_n = 0.0;
  const Vec3 pressed = sphere.centre_mm + Vec3(kSphereMm - 1.0, 0.4, 0.3);
  std::uint64_t revision = 0;
  const auto tick = [&](const Scene& scene, const Vec3& hip_mm) {
    const HapticOutput output =
        StepRenderer(scene.surface, scene.settings, hip_mm, kBallTickS, *state);
    last_n =
        std::exchange(force_n, safety.Step({.wrench_D = {output.force_D_n}}, kBallTickS).force_n);
    step_n = std::max(step_n, (force_n - last_n).norm());
    return output;
  };
  tick(SceneOf(sphere, balls[0], 0.5, ++revision), sphere.centre_mm + Vec3(30, 0, 0));
  for (const std::optional<FeltBall>& ball : balls) {
    const Scene scene = SceneOf(sphere, ball, 0.5, ++revision);
    HapticOutput output;
    for (int n = 0; n < 50; ++n) output = tick(scene, pressed);
    EXPECT_EQ(output.proxy.mode, ProxyMode::kConstrained);
    const double felt_mm = kSphereMm + (ball ? ball->ball().radius_mm : 0.0);
    EXPECT_NEAR((output.proxy.p_DH_mm - sphere.centre_mm).norm(), felt_mm, 0.15);
    EXPECT_LE((force_n - last_n).norm(), 1e-3);  // it has come to rest
  }
  EXPECT_LE(step_n, testing::kMaxStepN);
}

TEST(FeltBall, FollowsTheVolumeAndKeepsItsRevisions) {
  const auto volume = testing::Gyroid(32);
  const Ball ball{.radius_mm = 2.0};
  FeltBall felt(ball, *volume);
  const auto edited =
      testing::WithChanges(*volume, testing::PaintedBox(volume->bricks(), Vec3i(9, 9, 9),
                                                        Vec3i(12, 12, 12), [] { return 0.9f; }));
  EXPECT_LT(*felt.BytesToFollow(*edited), FeltBall::MostBytes(ball, *edited));
  felt.Follow(*edited);
  EXPECT_EQ(felt.field()->revision(), edited->revision());
  EXPECT_EQ(felt.field()->bricks().content_hash(),
            FeltBall(ball, *edited).field()->bricks().content_hash());
  EXPECT_LT(felt.field()->bricks().ChangedSince(volume->revision()).size(),
            static_cast<std::size_t>(felt.field()->bricks().brick_count().prod() / 2));
  EXPECT_FALSE(felt.BytesToFollow(*volume));
  felt.Follow(*volume);  // back
  EXPECT_EQ(felt.field()->bricks().content_hash(),
            FeltBall(ball, *volume).field()->bricks().content_hash());
  const AffineMap X_DI{2.0 * Mat3::Identity(), Vec3::Zero()};
  EXPECT_DOUBLE_EQ(felt.RadiusMm(X_DI), 4.0);
}

}  // namespace
}  // namespace palpate
