// The ball of the settings: when it is felt, and what is felt until then.
#include <gtest/gtest.h>

#include <cmath>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "server/session/session.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/running_session.h"
#include "tests/support/setting_choice.h"

namespace palpate {
namespace {

using testing::Choice;
using testing::kNever;
using testing::kQuiet;
using testing::Refusal;

SettingsUpdate Radius(double mm) { return {.numbers = {{&HapticSettings::tool_radius_mm, mm}}}; }

// What the servo got: never a field of other voxels than the volume's.
class SessionBallTest : public ::testing::Test,
                        protected testing::RunningSession,
                        public SceneListener {
 protected:
  explicit SessionBallTest(VolumeLoader loader = {}) : RunningSession(std::move(loader)) {}
  void SetUp() override {
    Load("builtin:sphere:32");
    Start();
    voxel_mm_ = session().volume().X_DI.linear.colwise().norm().minCoeff();
  }
  void OnScene(const Scene& scene, std::span<const BrickChange>) override {
    const std::lock_guard lock(mutex_);
    felt_mm_.push_back(scene.ball ? scene.ball->radius_mm : 0.0);
    sides_.push_back(scene.surface.free_side);
    ball_ = scene.ball;
    EXPECT_EQ(scene.surface.volume, scene.felt_volume().get());
    if (!ball_) return;
    EXPECT_EQ(ball_->field->revision(), scene.volume->revision());
    EXPECT_EQ(ball_->field->loaded_revision(), scene.volume->loaded_revision());
  }
  std::vector<double> TakeFelt() {
    const std::lock_guard lock(mutex_);
    return std::exchange(felt_mm_, {});
  }
  SceneBall Ball() {
    const std::lock_guard lock(mutex_);
    return ball_.value_or(SceneBall());
  }
  bool IsFelt(double radius_mm) {
    return test::Eventually([&] {
      const BallState ball = session().ball();
      return !ball.is_awaited && std::abs(ball.felt_radius_mm - radius_mm) < 1e-9;
    });
  }
  // The felt field is that of the volume now.
  void ExpectFieldOfVolume() {
    const SceneBall felt = Ball();
    ASSERT_TRUE(felt.field);
    EXPECT_EQ(felt.field->bricks().content_hash(),
              FeltBall(felt.ball, *volume()).field()->bricks().content_hash());
  }
  void Scale(double by) {
    session().Move([&](const VolumeState& now) {
      return Apply({.device_mm_per_volume_mm = by * now.registration.device_mm_per_volume_mm},
                   now.volume->metadata(), device(), now.registration);
    });
  }

  double voxel_mm_ = 0.0;
  std::mutex mutex_;  // guards what OnScene keeps
  std::vector<double> felt_mm_;
  std::vector<FreeSide> sides_;
  std::optional<SceneBall> ball_;
  Listening listening_{session(), *this};
};

TEST_F(SessionBallTest, IsFeltWhenItsFieldIsThereAndTheOldOneUntilThen) {
  EXPECT_EQ(session().ball(), BallState());
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  ExpectFieldOfVolume();
  EXPECT_FALSE(session().ball().share_done);
  TakeFelt();
  session().Update(Radius(4.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(4.0 * voxel_mm_));
  const std::vector<double> felt = TakeFelt();
  ASSERT_GE(felt.size(), 2u);
  EXPECT_NEAR(felt.front(), 2.0 * voxel_mm_, 1e-9);
  session().Update({.isovalue = 0.4});
  EXPECT_NEAR(TakeFelt().back(), 4.0 * voxel_mm_, 1e-9);
  session().Update(Radius(0.0));  // needs no field
  EXPECT_EQ(TakeFelt().back(), 0.0);
}

TEST_F(SessionBallTest, RadiiThatTheVolumeCannotHaveAreRefused) {
  session().Update(Radius(voxel_mm_));
  const std::uint64_t revision = session().settings().settings_revision;
  for (const double voxels : {0.29, 8.01}) {
    const std::string complaint =
        testing::Complaint([&] { session().Update(Radius(voxels * voxel_mm_)); });
    EXPECT_NE(complaint.find("0.3 to 8 voxels"), std::string::npos);
  }
  for (const double mm : {-1.0, std::nan(""), 101.0}) {
    EXPECT_EQ(Refusal([&] { session().Update(Radius(mm)); }), ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(session().settings().settings_revision, revision);
}

// The scale is more than the ball: a point is felt, which is told, until the ball can be again.
TEST_F(SessionBallTest, AScaleAtWhichItCannotBeTakesItAway) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  Scale(20.0);
  EXPECT_EQ(session().ball().felt_radius_mm, 0.0);
  EXPECT_NE(session().ball().problem.find("0.3 to 8 voxels"), std::string::npos);
  session().Update({.isovalue = 0.4});
  Scale(1.0 / 20.0);
  EXPECT_TRUE(IsFelt(2.0 * voxel_mm_));
}

TEST_F(SessionBallTest, FollowsEditsInTheirTransactions) {
  session().Update(Radius(3.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(3.0 * voxel_mm_));
  std::mt19937 random(1);
  for (int n = 0; n < 10; ++n) {
    RandomEdit(random);
    ExpectFieldOfVolume();
  }
}

// Edits come while the field is made: it is felt with them.
TEST_F(SessionBallTest, EditsDuringTheMakingAreNotLost) {
  std::mt19937 random(2);
  for (int n = 0; n < 5; ++n) {
    session().Update(Radius((1.5 + 0.5 * n) * voxel_mm_));
    while (!(std::abs(session().ball().felt_radius_mm - (1.5 + 0.5 * n) * voxel_mm_) < 1e-9)) {
      RandomEdit(random, 4);
    }
    ExpectFieldOfVolume();
  }
}

TEST_F(SessionBallTest, KeepsItsSizeOnTheDeviceWhenTheVolumeGetsAnotherScale) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  TakeFelt();
  Scale(1.5);
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  EXPECT_NEAR(TakeFelt().front(), 3.0 * voxel_mm_, 1e-9);  // until its field is made
  ExpectFieldOfVolume();
}

TEST_F(SessionBallTest, ErodesForTheOtherSideAndSwitchesWithItsField) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  session().Update({.choices = {Choice("free_side", FreeSide::kAbove)}});
  EXPECT_TRUE(test::Eventually([&] { return Ball().ball.is_least; }));
  ExpectFieldOfVolume();
  const std::lock_guard lock(mutex_);
  EXPECT_EQ(sides_.back(), FreeSide::kAbove);
}

TEST_F(SessionBallTest, AnotherVolumeComesWithItsFieldOrSaysWhyNot) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  TakeFelt();
  Load("builtin:gyroid:40");
  for (const double mm : TakeFelt()) EXPECT_NEAR(mm, 2.0 * voxel_mm_, 1e-9);
  ExpectFieldOfVolume();
  // Voxels much larger.
  session().Load({.source = "builtin:gyroid:40",
                  .device_mm_per_volume_mm = 9.0 * voxel_mm_,
                  .discards_edits = true},
                 kQuiet, kNever);
  EXPECT_EQ(TakeFelt().back(), 0.0);
  EXPECT_FALSE(session().ball().problem.empty());
  ASSERT_EQ(volume()->metadata().warnings.size(), 1u);
  EXPECT_NE(volume()->metadata().warnings[0].find("point"), std::string::npos);
  // What the load itself asks for is refused.
  const auto before = volume();
  EXPECT_EQ(Refusal([&] {
              session().Load({.source = "builtin:sphere:16"}, kQuiet, kNever, Radius(90.0));
            }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(volume(), before);
}

TEST_F(SessionBallTest, ALoadCanBeGivenUpWhileItsFieldIsMade) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  const auto before = volume();
  bool is_making = false;
  const auto progress = [&](std::string_view stage, double) {
    is_making = stage.find("ball") != std::string_view::npos;
  };
  EXPECT_EQ(Refusal([&] {
              session().Load({.source = "builtin:gyroid:40"}, progress, [&] { return is_making; });
            }),
            ErrorKind::kCancelled);
  EXPECT_EQ(volume(), before);
}

TEST_F(SessionBallTest, OfAReshapedVolumeItIsMadeAnew) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  session().store().Edit([&](const auto& present) {
    ReshapedVolume other{present->metadata(),
                         testing::MakeBricks(Vec3i::Constant(20), [](int i, int, int) {
                           return static_cast<float>(i) / 19.0f;
                         })};
    other.metadata.size = Vec3i::Constant(20);
    return VolumeChange(std::move(other));
  });
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  ExpectFieldOfVolume();
}

// Layers are felt from below, whatever the ball's side was.
TEST_F(SessionBallTest, LayersAreNeverFeltFromAbove) {
  session().Update(Radius(2.0 * voxel_mm_));
  session().Update({.choices = {Choice("free_side", FreeSide::kAbove)}});
  ASSERT_TRUE(test::Eventually([&] { return Ball().ball.is_least; }));
  const SurfaceLayers layers{{{.id = 0, .name = "a", .isovalue = 0.4, .stiffness_n_per_mm = 0.5}}};
  {
    const std::lock_guard lock(mutex_);
    sides_.clear();
  }
  session().Update({.choices = {Choice("free_side", FreeSide::kBelow)}, .layers = layers});
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  const std::lock_guard lock(mutex_);
  for (const FreeSide side : sides_) EXPECT_EQ(side, FreeSide::kBelow);
}

class SmallBudget : public SessionBallTest {
 protected:
  SmallBudget() : SmallBudget(MemoryBudget::Make(1 << 19)) {}

  std::shared_ptr<MemoryBudget> budget_;

 private:
  explicit SmallBudget(std::shared_ptr<MemoryBudget> budget)
      : SessionBallTest(LoaderWith(budget)), budget_(budget) {}
  static VolumeLoader LoaderWith(std::shared_ptr<MemoryBudget> budget) {
    VolumeLoader loader;
    loader.budget = std::move(budget);
    return loader;
  }
};

TEST_F(SmallBudget, ABallWithoutRoomIsRefused) {
  const std::uint64_t revision = session().settings().settings_revision;
  // A margin of 16 voxels.
  EXPECT_EQ(Refusal([&] { session().Update(Radius(8.0 * voxel_mm_)); }), ErrorKind::kTooLarge);
  EXPECT_EQ(session().settings().settings_revision, revision);
  EXPECT_EQ(session().ball(), BallState());
}

TEST_F(SmallBudget, WhatCouldNotBeMadeIsToldAndTriedAgainWhenAskedFor) {
  session().Update(Radius(2.0 * voxel_mm_));
  ASSERT_TRUE(IsFelt(2.0 * voxel_mm_));
  const auto problem = [&] { return session().ball().problem; };
  {
    const MemoryClaim other = budget_->Claim("another", budget_->left_bytes());
    session().Update({.choices = {Choice("free_side", FreeSide::kAbove)}});
    EXPECT_TRUE(test::Eventually([&] { return !problem().empty(); }));
    EXPECT_FALSE(session().ball().is_awaited);
  }
  session().Update(Radius(2.0 * voxel_mm_));
  EXPECT_TRUE(problem().empty());
  EXPECT_TRUE(test::Eventually([&] { return Ball().ball.is_least; }));
}

}  // namespace
}  // namespace palpate
