// What tools make of samples: buttons, faults, lost samples, scenes that change.
#include "server/session/tools/tools.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/made_volume.h"

namespace palpate {
namespace {

class ToolStrokesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    scene_.volume = testing::MakeVolume(Vec3i(8, 8, 8), [](int i, int, int) { return 10.0 * i; });
    scene_.settings = {
        .carve_radius_mm = 3.0, .carve_rate_per_s = 2.0, .carve_tool = true, .clutch_tool = true};
    PublishAt({Mat3::Identity() * 0.5, Vec3(1, 2, 3)});
  }

  void PublishAt(const AffineMap& X_DI) {
    scene_.surface = MakeHapticSurface(*scene_.volume, X_DI, 0.5, DecompositionMethod::kTpbcc, 1);
    Publish();
  }
  void Publish() {
    ++scene_.scene_revision;
    strokes_.OnScene(scene_);
  }

  // A tick with these buttons.
  bool Tick(std::uint32_t buttons, const Vec3& p_mm = Vec3::Zero(),
            const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity()) {
    TickSample sample = Sample(buttons, p_mm);
    sample.stylus_orientation = {q.w(), q.x(), q.y(), q.z()};
    return strokes_.OnSample(sample);
  }
  TickSample Sample(std::uint32_t buttons, const Vec3& p_mm) {
    TickSample sample;
    sample.tick = tick_++;
    sample.time_ns = 1'000'000 * static_cast<std::int64_t>(sample.tick);
    sample.scene_revision = scene_.scene_revision;
    sample.hip_mm = sample.scp_h_mm = {p_mm.x(), p_mm.y(), p_mm.z()};
    sample.buttons = buttons;
    const bool clutched = scene_.settings.clutch_tool && (buttons & kClutchButton) != 0;
    if (clutched || scene_.forces_off) sample.mode = ProxyMode::kSuspended;
    return sample;
  }
  // Sum of what would be added.
  double Carved() {
    double value = 0.0;
    for (const CarveStep& step : strokes_.TakeCarving()) value += step.value;
    return value;
  }

  Scene scene_;
  ToolStrokes strokes_;
  std::uint64_t tick_ = 0;
};

Eigen::Quaterniond Turn(double angle_rad) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle_rad, Vec3(1, 2, 3).normalized()));
}

TEST_F(ToolStrokesTest, AReleaseGivesTheMotionSinceThePress) {
  Tick(0, Vec3(9, 9, 9));
  EXPECT_FALSE(Tick(kClutchButton, Vec3(1, 0, 0)));
  EXPECT_FALSE(Tick(kClutchButton, Vec3(2, 0, 0)));
  EXPECT_FALSE(strokes_.TakeMotion().has_value());
  EXPECT_FALSE(Tick(kClutchButton, Vec3(4, 5, 6), Turn(0.3)));
  EXPECT_TRUE(Tick(0, Vec3(90, 0, 0), Turn(2.0)));
  const auto motion = strokes_.TakeMotion();
  ASSERT_TRUE(motion.has_value());
  EXPECT_LT((motion->Apply(Vec3(1, 0, 0)) - Vec3(4, 5, 6)).norm(), 1e-14);
  EXPECT_LT(motion->R.angularDistance(Turn(0.3)), 1e-14);
  EXPECT_FALSE(strokes_.TakeMotion().has_value());
  // A stylus at rest moves nothing.
  for (int n = 0; n < 100; ++n) EXPECT_FALSE(Tick(kClutchButton, Vec3(1, 2, 3), Turn(1.0)));
  EXPECT_FALSE(Tick(0));
  EXPECT_FALSE(strokes_.TakeMotion().has_value());
}

TEST_F(ToolStrokesTest, ABallCarvesWhatItTouchesUnlessTheToolIsLarger) {
  for (const double ball_mm : {4.0, 1.0}) {
    scene_.ball = SceneBall{scene_.volume, {}, ball_mm, scene_.surface.X_DI};
    Publish();
    Tick(kCarveButton);
    Tick(kCarveButton, Vec3(1, 0, 0));
    Tick(0);
    const auto steps = strokes_.TakeCarving();
    ASSERT_EQ(steps.size(), 1u);
    // The ball has twice its radius in W; half a millimetre is a voxel.
    EXPECT_NEAR(steps[0].full_mm, ball_mm > 3.0 ? 8.0 : 3.0, 1e-12);
    EXPECT_NEAR(steps[0].radius_mm, ball_mm > 3.0 ? 8.0 + 0.75 : 6.0, 1e-12);
  }
}

// What stops it is up to a voxel and a half away.
TEST_F(ToolStrokesTest, ABallCarvesAheadWhereItIsPressedTo) {
  scene_.ball = SceneBall{scene_.volume, {}, 4.0, scene_.surface.X_DI};
  for (const double rate_per_s : {2.0, -2.0}) {
    scene_.settings.carve_rate_per_s = rate_per_s;
    Publish();
    for (const double pressed_mm : {0.3, 5.0}) {
      for (int n = 0; n < 2; ++n) {
        TickSample sample = Sample(kCarveButton, Vec3(1, 2, 3));
        sample.hip_mm[2] -= pressed_mm;
        strokes_.OnSample(sample);
      }
      Tick(0);
      const auto steps = strokes_.TakeCarving();
      ASSERT_EQ(steps.size(), 1u);
      const double ahead_mm = rate_per_s > 0.0 ? std::min(pressed_mm, 1.5 * 0.5) : 0.0;
      const Vec3 expected = 2.0 * (Vec3(1, 2, 3 - ahead_mm) - Vec3(1, 2, 3));
      EXPECT_LT((steps[0].p_WTo_mm - expected).norm(), 1e-12);
    }
  }
}

// Each at its own place on the tool as it is felt; others do not carve.
TEST_F(ToolStrokesTest, OfAToolTheBallsThatCarveDo) {
  const auto tool = std::make_shared<SceneTool>();
  tool->held.ball = {{Vec3(0, 0, 1), 4.0, true}, {Vec3(0, 0, 5), 1.0}, {Vec3(3, 0, 0), 2.0, true}};
  scene_.tool = tool;
  Publish();
  const Eigen::Quaterniond q = Turn(1.0);
  const auto carve = [&] {
    for (int n = 0; n < 2; ++n) {
      TickSample sample = Sample(kCarveButton, Vec3(1, 2, 3));
      sample.stylus_orientation = sample.tool_orientation = {q.w(), q.x(), q.y(), q.z()};
      strokes_.OnSample(sample);
    }
    Tick(0);
    return strokes_.TakeCarving();
  };
  const auto steps = carve();
  ASSERT_EQ(steps.size(), 2u);
  for (std::size_t n = 0; n < 2; ++n) {
    const HeldToolBall& ball = tool->held.ball[2 * n];
    EXPECT_LT((steps[n].p_WTo_mm - 2.0 * (q * ball.center_mm)).norm(), 1e-12);
    EXPECT_NEAR(steps[n].full_mm, 2.0 * ball.radius_mm, 1e-12);
  }
  // What is put down carves no more.
  scene_.tool.reset();
  Publish();
  for (int press = 0; press < 3; ++press) EXPECT_EQ(carve().size(), 1u) << press;
}

TEST_F(ToolStrokesTest, BothButtonsAtOnceMoveAndDoNotCarve) {
  for (int n = 0; n <= 100; ++n) Tick(kCarveButton | kClutchButton, Vec3(n, 0, 0));
  EXPECT_TRUE(Tick(0));
  EXPECT_LT((strokes_.TakeMotion()->t_mm - Vec3(100, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(Carved(), 0.0);
}

TEST_F(ToolStrokesTest, PressesThatWereNotTakenAddUp) {
  const Vec3 p(7, -3, 2);
  for (int n = 0; n < 5; ++n) {
    Tick(kClutchButton, Vec3(n, 0, 0));
    Tick(kClutchButton, Vec3(n, 10, 0), Turn(0.2));
    Tick(0, Vec3(100, 100, 100));
  }
  const auto motion = strokes_.TakeMotion();
  ASSERT_TRUE(motion.has_value());
  Vec3 expected = p;
  for (int n = 0; n < 5; ++n) expected = Turn(0.2) * (expected - Vec3(n, 0, 0)) + Vec3(n, 10, 0);
  EXPECT_LT((motion->Apply(p) - expected).norm(), 1e-12);
}

TEST_F(ToolStrokesTest, StepsAddUpToTheWholeMotion) {
  RigidMotion whole;
  int steps = 0;
  for (int n = 0; n < 10'000; ++n) {
    const double at = 1e-3 * n;
    if (Tick(kClutchButton, Vec3(std::sin(at), at, std::cos(3 * at)), Turn(at))) {
      whole = *strokes_.TakeMotion() * whole;
      ++steps;
    }
  }
  Tick(0);
  if (const auto rest = strokes_.TakeMotion()) whole = *rest * whole;
  EXPECT_NEAR(steps, 600, 15);
  const double end = 9.999;
  EXPECT_LT((whole.Apply(Vec3(0, 0, 1)) - Vec3(std::sin(end), end, std::cos(3 * end))).norm(),
            1e-10);
  EXPECT_LT(whole.R.angularDistance(Turn(end)), 1e-10);
  EXPECT_NEAR(whole.R.norm(), 1.0, 1e-14);
}

TEST_F(ToolStrokesTest, FaultsAndOrientationsThatAreNoneArePassedOver) {
  Tick(kClutchButton, Vec3(0, 0, 0));
  Tick(kClutchButton, Vec3(1, 0, 0));
  TickSample fault = Sample(kClutchButton, Vec3(500, 0, 0));
  fault.mode = ProxyMode::kFault;
  strokes_.OnSample(fault);
  for (const Eigen::Quaterniond& bad :
       {Eigen::Quaterniond(std::nan(""), 0, 0, 0), Eigen::Quaterniond(0, 0, 0, 0),
        Eigen::Quaterniond(2, 0, 0, 0), Eigen::Quaterniond(1, HUGE_VAL, 0, 0)}) {
    Tick(kClutchButton, Vec3(300, 0, 0), bad);
  }
  Tick(kClutchButton, Vec3(2, 0, 0));
  ASSERT_TRUE(Tick(0));
  const auto motion = strokes_.TakeMotion();
  EXPECT_LT((motion->t_mm - Vec3(2, 0, 0)).norm(), 1e-14);
  EXPECT_EQ(motion->R.angularDistance(Eigen::Quaterniond::Identity()), 0.0);
}

TEST_F(ToolStrokesTest, WhereSamplesWereLostAStrokeEnds) {
  Tick(kClutchButton, Vec3(0, 0, 0));
  Tick(kClutchButton, Vec3(1, 0, 0));
  tick_ += 5000;
  EXPECT_TRUE(Tick(kClutchButton, Vec3(50, 0, 0)));
  Tick(kClutchButton, Vec3(52, 0, 0));
  Tick(0);
  EXPECT_LT((strokes_.TakeMotion()->t_mm - Vec3(3, 0, 0)).norm(), 1e-14);
  // Nor is the gap carved away.
  Tick(kCarveButton);
  Tick(kCarveButton);
  tick_ += 5000;
  Tick(kCarveButton, Vec3(50, 0, 0));
  Tick(0);
  EXPECT_NEAR(Carved(), -2.0 * 70.0 * 1e-3, 1e-12);
}

TEST_F(ToolStrokesTest, AToolIsJudgedByTheSceneOfItsTick) {
  // Published, but not used by a tick yet.
  TickSample before = Sample(kClutchButton, Vec3(0, 0, 0));
  scene_.settings.clutch_tool = false;
  Publish();
  strokes_.OnSample(before);
  before.tick = tick_++;
  before.hip_mm = {3, 0, 0};
  strokes_.OnSample(before);
  EXPECT_TRUE(Tick(kClutchButton, Vec3(9, 0, 0)));  // off now
  EXPECT_EQ(strokes_.TakeMotion()->t_mm, Vec3(3, 0, 0));
  // Forces that are off for another reason are no clutch.
  scene_.forces_off = true;
  Publish();
  Tick(kClutchButton, Vec3(0, 0, 0));
  Tick(kClutchButton, Vec3(9, 0, 0));
  EXPECT_FALSE(Tick(0));
}

TEST_F(ToolStrokesTest, ScenesThatAreNotKnownHaveNoTools) {
  TickSample sample = Sample(kCarveButton | kClutchButton, Vec3::Zero());
  sample.scene_revision = 77;
  for (int n = 0; n < 100; ++n) {
    sample.hip_mm[0] += 1.0;
    EXPECT_FALSE(strokes_.OnSample(sample));
    ++sample.tick;
    sample.time_ns += 1'000'000;
  }
  ToolStrokes none;
  EXPECT_FALSE(none.OnSample(sample));
  // A servo that stands still, and a client that does not.
  for (int n = 0; n < 10'000; ++n) Publish();
  Tick(kClutchButton, Vec3(0, 0, 0));
  Tick(kClutchButton, Vec3(1, 0, 0));
  EXPECT_TRUE(Tick(0));
}

TEST_F(ToolStrokesTest, CarvesAtItsRate) {
  for (int n = 0; n <= 1000; ++n) Tick(kCarveButton, Vec3(1e-3 * n, 0, 0));
  double value = Carved();  // some were left out: nobody took them
  EXPECT_GT(value, -2.0 * 70.0);
  value = 0.0;
  for (int n = 0; n <= 1000; ++n) {
    if (Tick(kCarveButton)) value += Carved();
  }
  Tick(0);
  value += Carved();
  EXPECT_NEAR(value, -2.0 * 70.0 * 1.001, 2.0 * 70.0 * 0.02);
  // A fault does not save it up.
  Tick(kCarveButton);
  for (int n = 0; n < 3000; ++n) {
    TickSample fault = Sample(kCarveButton, Vec3::Zero());
    fault.mode = ProxyMode::kFault;
    EXPECT_FALSE(strokes_.OnSample(fault));
  }
  Tick(kCarveButton);
  Tick(0);
  EXPECT_GE(Carved(), -2.0 * 70.0 * 0.0167);
}

TEST_F(ToolStrokesTest, AStepIsTheWayOfTheProxyInTheWorld) {
  Tick(kCarveButton, Vec3(1, 2, 3));
  Tick(kCarveButton, Vec3(2, 2, 3));
  Tick(kCarveButton, Vec3(3, 2, 4));
  Tick(0, Vec3(50, 50, 50));
  const auto steps = strokes_.TakeCarving();
  ASSERT_EQ(steps.size(), 1u);
  EXPECT_EQ(steps[0].stroke, 1u);
  EXPECT_EQ(steps[0].loaded_revision, 1u);
  EXPECT_LT((steps[0].p_WFrom_mm - Vec3(0, 0, 0)).norm(), 1e-14);
  EXPECT_LT((steps[0].p_WTo_mm - Vec3(4, 0, 2)).norm(), 1e-14);
  EXPECT_NEAR(steps[0].radius_mm, 6.0, 1e-14);
  EXPECT_NEAR(steps[0].value, -2.0 * 70.0 * 2e-3, 1e-14);
}

TEST_F(ToolStrokesTest, TheSignIsThatOfWhatIsFeltAsMaterial) {
  for (const FreeSide side : {FreeSide::kBelow, FreeSide::kAbove}) {
    for (const double rate : {1.0, -1.0}) {
      scene_.settings.carve_rate_per_s = rate;
      Publish();
      for (int n = 0; n < 5; ++n) {
        TickSample sample = Sample(kCarveButton, Vec3::Zero());
        sample.free_side = side;
        strokes_.OnSample(sample);
      }
      Tick(0);
      const double sign = side == FreeSide::kBelow ? -1.0 : 1.0;
      EXPECT_NEAR(Carved(), sign * rate * 70.0 * 4e-3, 1e-12);
    }
  }
}

TEST_F(ToolStrokesTest, AVolumeThatMovesIsNotSweptThrough) {
  Tick(kCarveButton, Vec3(1, 2, 3));
  Tick(kCarveButton, Vec3(1, 2, 3));
  PublishAt({Mat3::Identity() * 0.5, Vec3(101, 2, 3)});
  Tick(kCarveButton, Vec3(1, 2, 3));
  Tick(kCarveButton, Vec3(1, 2, 3));
  Tick(0);
  const auto steps = strokes_.TakeCarving();
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(steps[0].stroke, steps[1].stroke);
  for (const CarveStep& step : steps) EXPECT_EQ(step.p_WFrom_mm, step.p_WTo_mm);
  EXPECT_LT((steps[1].p_WFrom_mm - Vec3(-200, 0, 0)).norm(), 1e-12);
}

TEST_F(ToolStrokesTest, AnotherVolumeIsAnotherStroke) {
  Tick(kCarveButton);
  Tick(kCarveButton);
  scene_.volume = testing::MakeVolume(
      Vec3i(8, 8, 8), [](int i, int, int) { return 1.0 * i; }, 2);
  PublishAt(scene_.surface.X_DI);
  Tick(kCarveButton);
  Tick(kCarveButton);
  Tick(0);
  const auto steps = strokes_.TakeCarving();
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_EQ(steps[0].loaded_revision, 1u);
  EXPECT_EQ(steps[1].loaded_revision, 2u);
  EXPECT_NE(steps[0].stroke, steps[1].stroke);
  EXPECT_NEAR(steps[1].value / steps[0].value, 0.1, 1e-9);  // of another range
}

TEST_F(ToolStrokesTest, StepsThatNobodyTakesAreLeftOutFromTheOldest) {
  for (int n = 0; n < 20'000; ++n) Tick(kCarveButton, Vec3(n, 0, 0));
  const auto steps = strokes_.TakeCarving();
  EXPECT_EQ(steps.size(), ToolStrokes::kMostCarveSteps);
  EXPECT_GT(steps.front().p_WFrom_mm.x(), 30'000.0);
  for (std::size_t n = 1; n < steps.size(); ++n) {
    EXPECT_EQ(steps[n].p_WFrom_mm, steps[n - 1].p_WTo_mm);
  }
}

TEST_F(ToolStrokesTest, StraightStepsThatWaitBecomeOne) {
  for (int n = 0; n <= 90; ++n) Tick(kCarveButton, Vec3(0.1 * n, 0, 0));
  Tick(0);
  const auto steps = strokes_.TakeCarving();
  ASSERT_EQ(steps.size(), 1u);
  EXPECT_NEAR(steps[0].value, -2.0 * 70.0 * 0.09, 1e-9);
  EXPECT_EQ(steps[0].duration_ns, 90'000'000);
  EXPECT_NEAR((steps[0].p_WTo_mm - steps[0].p_WFrom_mm).norm(), 18.0, 1e-9);
}

TEST_F(ToolStrokesTest, BentStepsThatWaitDoNot) {
  // A corner every second step, 34 mm in W from corner to corner.
  for (int n = 0; n <= 68; ++n) {
    const int leg = n / 34, rest = n % 34;
    Tick(kCarveButton, leg == 0 ? Vec3(0.5 * rest, 0, 0) : Vec3(17, 0.5 * rest, 0));
  }
  Tick(0);
  const auto steps = strokes_.TakeCarving();
  ASSERT_GE(steps.size(), 2u);
  double value = 0.0;
  for (std::size_t n = 0; n < steps.size(); ++n) {
    value += steps[n].value;
    if (n > 0) {
      EXPECT_EQ(steps[n].p_WFrom_mm, steps[n - 1].p_WTo_mm);
    }
  }
  EXPECT_NEAR(value, -2.0 * 70.0 * 0.068, 1e-9);
  // Nor do those of two presses.
  for (const std::uint32_t buttons : {1u, 1u, 1u, 0u, 1u, 1u, 1u, 0u}) Tick(buttons);
  EXPECT_EQ(strokes_.TakeCarving().size(), 2u);
}

}  // namespace
}  // namespace palpate
