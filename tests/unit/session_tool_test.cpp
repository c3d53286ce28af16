// The tool of the settings: when it is felt, and where it is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <mutex>
#include <random>
#include <span>
#include <string>

#include "server/session/held_tool.h"
#include "server/session/session.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/refusal.h"
#include "tests/support/running_session.h"

namespace palpate {
namespace {

using testing::Refusal;

class SessionToolTest : public ::testing::Test,
                        protected testing::RunningSession,
                        public SceneListener {
 protected:
  void SetUp() override {
    Load("builtin:sphere:32");
    Start();
    voxel_mm_ = session().volume().X_DI.linear.colwise().norm().minCoeff();
  }
  void OnScene(const Scene& scene, std::span<const BrickChange>) override {
    const std::lock_guard lock(mutex_);
    tool_ = scene.tool;
    if (!tool_) return;
    // Never fields of other voxels than the volume's.
    for (int n = 0; n < tool_->felt.tool.radius_count; ++n) {
      EXPECT_EQ(tool_->felt.surface[n].volume, tool_->volume[n].get());
      EXPECT_EQ(tool_->volume[n]->revision(), scene.volume->revision());
      EXPECT_EQ(tool_->volume[n]->loaded_revision(), scene.volume->loaded_revision());
    }
  }
  std::shared_ptr<const SceneTool> Felt() {
    const std::lock_guard lock(mutex_);
    return tool_;
  }
  bool IsFelt(const HeldTool& tool) {
    return test::Eventually([&] {
      const auto felt = Felt();
      return !session().ball().is_awaited && felt && felt->held == tool;
    });
  }
  // A burr, a shaft, and a point.
  HeldTool Drill() const {
    return {.name = "drill",
            .ball = {{Vec3::Zero(), 3.0 * voxel_mm_, true},
                     {Vec3(0, 0, 10.0), voxel_mm_},
                     {Vec3(0, 0, 14.0), voxel_mm_},
                     {Vec3(0, 0, 20.0), 0.0}},
            .rotation_length_mm = 25.0};
  }

  double voxel_mm_ = 0.0;
  std::mutex mutex_;  // guards tool_
  std::shared_ptr<const SceneTool> tool_;
  Listening listening_{session(), *this};
};

TEST_F(SessionToolTest, IsFeltWithAllItsFieldsAndPutDownAtOnce) {
  const HeldTool drill = Drill();
  session().Update({.tool = drill});
  ASSERT_TRUE(IsFelt(drill));
  const RigidTool& shape = Felt()->felt.tool;
  EXPECT_EQ(shape.count, 4);
  EXPECT_EQ(shape.radius_count, 3);
  EXPECT_EQ(shape.rotation_length_mm, 25.0);
  EXPECT_EQ(shape.balls()[2].radius, shape.balls()[1].radius);
  EXPECT_EQ(Felt()->volume[2], volume());  // of the point
  // The next tool, with radii that are there, needs no field.
  HeldTool shorter = drill;
  shorter.ball.pop_back();
  session().Update({.tool = shorter});
  EXPECT_EQ(Felt()->held, shorter);
  session().Update({.tool = HeldTool()});
  EXPECT_FALSE(Felt());
}

TEST_F(SessionToolTest, FollowsEditsAndAnotherVolume) {
  const HeldTool drill = Drill();
  session().Update({.tool = drill});
  ASSERT_TRUE(IsFelt(drill));
  std::mt19937 random(1);
  for (int n = 0; n < 5; ++n) {
    RandomEdit(random);
    ASSERT_TRUE(Felt());
    for (std::size_t k = 0; k < 2; ++k) {
      EXPECT_EQ(Felt()->volume[k]->bricks().content_hash(),
                FeltBall(Felt()->fields[k], *volume()).field()->bricks().content_hash());
    }
  }
  Load("builtin:gyroid:32");
  EXPECT_TRUE(IsFelt(drill));
}

TEST_F(SessionToolTest, WhatCannotBeIsRefusedAndChangesNothing) {
  const auto refusal_of = [&](const std::function<void(HeldTool&)>& change) {
    HeldTool tool = Drill();
    change(tool);
    return Refusal([&] { session().Update({.tool = tool}); });
  };
  const auto invalid = ErrorKind::kInvalidArgument;
  const std::uint64_t revision = session().settings().settings_revision;
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.ball.resize(65, t.ball.front()); }), invalid);
  EXPECT_EQ(refusal_of([&](HeldTool& t) { t.ball[1].radius_mm *= 2.0; }), invalid);  // 4 radii
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.ball[1].radius_mm = -1.0; }), invalid);
  EXPECT_EQ(refusal_of([&](HeldTool& t) { t.ball[0].radius_mm = 8.1 * voxel_mm_; }), invalid);
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.ball[0].center_mm.x() = 501.0; }), invalid);
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.ball[0].center_mm.x() = std::nan(""); }), invalid);
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.rotation_length_mm = 0.5; }), invalid);
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.ball[0].center_mm.x() = 20.1 * t.rotation_length_mm; }),
            invalid);
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.ball[3].carves = true; }), invalid);  // a point
  EXPECT_EQ(refusal_of([](HeldTool& t) { t.name = "a\nb"; }), invalid);
  EXPECT_EQ(session().settings().settings_revision, revision);
}

// Whichever comes second is refused.
TEST_F(SessionToolTest, NoToolWithEffectsThatItDoesNotHave) {
  const auto forbidden = ErrorKind::kFailedPrecondition;
  for (const auto member : {&HapticSettings::pop_force_n, &HapticSettings::static_friction,
                            &HapticSettings::magnet_force_n, &HapticSettings::texture_force_n}) {
    session().Update({.numbers = {{member, 1.0}}});
    EXPECT_EQ(Refusal([&] { session().Update({.tool = Drill()}); }), forbidden);
    session().Update({.numbers = {{member, 0.0}}, .tool = Drill()});
    EXPECT_EQ(Refusal([&] { session().Update({.numbers = {{member, 1.0}}}); }), forbidden);
    session().Update({.tool = HeldTool()});
  }
  session().Update({.tool = Drill()});
  const SurfaceLayers layers{{{.name = "skin", .isovalue = 0.4}}};
  EXPECT_EQ(Refusal([&] { session().Update({.layers = layers}); }), forbidden);
  EXPECT_EQ(Refusal([&] {
              session().Update({.flags = {{&HapticSettings::force_shading, true}}});
            }),
            forbidden);
}

TEST(SessionTool, NoToolOnADeviceThatDoesNotSenseItsTurns) {
  HapticSettings haptics;
  haptics.tool.ball = {{Vec3::Zero(), 1.0}};
  DeviceDescription device = SimulatedDeviceSpec();
  EXPECT_NO_THROW(CheckHeld(haptics, device));
  device.senses_orientation = false;
  EXPECT_EQ(Refusal([&] { CheckHeld(haptics, device); }), ErrorKind::kFailedPrecondition);
  haptics.tool = {};
  EXPECT_NO_THROW(CheckHeld(haptics, device));
}

}  // namespace
}  // namespace palpate
