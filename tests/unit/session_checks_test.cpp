// Layers and the tool of the settings: what is refused, what another volume keeps, and what the
// servo gets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <mutex>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "server/session/session.h"
#include "server/session/setting_checks.h"
#include "server/simulated_hand/simulated_device.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/running_session.h"
#include "tests/support/setting_choice.h"

namespace palpate {

namespace {

using testing::Choice;
using testing::Complaint;
using testing::kNever;
using testing::kQuiet;
using testing::Refusal;

SurfaceLayer Layer(std::uint32_t id, const std::string& name, double isovalue) {
  return {.id = id, .name = name, .isovalue = isovalue, .stiffness_n_per_mm = 0.5};
}

// Values from 0 to 1.
class SessionLayersTest : public ::testing::Test,
                          protected testing::RunningSession,
                          public SceneListener {
 protected:
  void SetUp() override {
    Load("builtin:sphere:32");
    Start();
  }
  void OnScene(const Scene& scene, std::span<const BrickChange>) override {
    felt_ids_.clear();
    if (scene.surface.layers == nullptr) return;
    for (const HapticLayer& layer : scene.surface.layers->all()) felt_ids_.push_back(layer.id);
  }
  SurfaceLayers Layers() { return session().settings().settings.haptics.layers; }

  std::vector<int> felt_ids_;  // of the last scene
  Listening listening_{session(), *this};
};

TEST_F(SessionLayersTest, AreAnsweredInOrderFromOutside) {
  session().Update({.layers = SurfaceLayers{{Layer(1, "bone", 0.6), Layer(7, "skin", 0.3)}}});
  ASSERT_EQ(Layers().layer.size(), 2u);
  EXPECT_EQ(Layers().layer[0].name, "skin");
  EXPECT_EQ(Layers().layer[1].name, "bone");
  EXPECT_EQ(felt_ids_, (std::vector<int>{7, 1}));
  session().Update({.layers = SurfaceLayers{}});
  EXPECT_TRUE(Layers().layer.empty());
  EXPECT_TRUE(felt_ids_.empty());
}

// A stylus that has passed skin has not passed what comes in its place.
TEST_F(SessionLayersTest, WithoutAnIdTheyGetThatOfTheirNameOrANewOne) {
  const auto ids = [&] {
    std::vector<std::uint32_t> found;
    for (const SurfaceLayer& layer : Layers().layer) found.push_back(layer.id);
    return found;
  };
  session().Update({.layers = SurfaceLayers{{Layer(0, "skin", 0.3), Layer(0, "bone", 0.6)}}});
  EXPECT_EQ(ids(), (std::vector<std::uint32_t>{1, 2}));
  session().Update({.layers = SurfaceLayers{{Layer(0, "fat", 0.4), Layer(0, "bone", 0.6)}}});
  EXPECT_EQ(ids(), (std::vector<std::uint32_t>{3, 2}));
  SurfaceLayers eight;  // no id is left that none of them had
  for (int n = 0; n < 8; ++n) eight.layer.push_back(Layer(0, std::to_string(n), 0.1 + 0.1 * n));
  std::ranges::reverse(eight.layer);
  session().Update({.layers = eight});
  EXPECT_EQ(ids(), (std::vector<std::uint32_t>{1, 4, 5, 6, 7, 8, 2, 3}));
}

TEST_F(SessionLayersTest, BadOnesChangeNothing) {
  const SurfaceLayers good{{Layer(1, "skin", 0.3), Layer(2, "bone", 0.6)}};
  session().Update({.layers = good});
  const std::uint64_t revision = session().settings().settings_revision;
  const auto refuses = [&](const std::function<void(SurfaceLayers&)>& spoil) {
    SurfaceLayers bad = good;
    spoil(bad);
    return Refusal([&] { session().Update({.layers = bad}); }) == ErrorKind::kInvalidArgument;
  };
  EXPECT_TRUE(refuses([](auto& l) {
    for (std::uint32_t id = 3; id <= 9; ++id) {
      l.layer.push_back(Layer(id, std::to_string(id), 0.1 * id));
    }
  }));
  EXPECT_TRUE(refuses([](auto& l) { l.layer[0].id = 9; }));
  EXPECT_TRUE(refuses([](auto& l) { l.layer[0].id = 2; }));
  for (const std::string& name : {std::string(), std::string("bone"), std::string("a\nb"),
                                  std::string("\xff"), std::string(32, 'a')}) {
    EXPECT_TRUE(refuses([&](auto& l) { l.layer[0].name = name; })) << name;
  }
  for (const double isovalue : {-0.1, 1.1, std::nan(""), 0.6 - 9e-7}) {
    EXPECT_TRUE(refuses([&](auto& l) { l.layer[0].isovalue = isovalue; })) << isovalue;
  }
  EXPECT_TRUE(refuses([](auto& l) { l.layer[0].stiffness_n_per_mm = 3.1; }));
  EXPECT_TRUE(refuses([](auto& l) { l.layer[0].dynamic_friction = std::nan(""); }));
  EXPECT_TRUE(refuses([](auto& l) { l.layer[0].pop_out_force_n = 3.4; }));
  // What layers replace.
  const SettingsUpdate replaced[] = {{.isovalue = 0.4},
                                     {.normalized_isovalue = 0.4},
                                     {.numbers = {{&HapticSettings::stiffness_n_per_mm, 1.0}}},
                                     {.numbers = {{&HapticSettings::pop_force_n, 1.0}}},
                                     {.choices = {Choice("free_side", FreeSide::kAbove)}}};
  for (const SettingsUpdate& update : replaced) {
    EXPECT_NE(Complaint([&] { session().Update(update); }).find("remove"),
              std::string::npos);
  }
  EXPECT_EQ(session().settings().settings_revision, revision);
  EXPECT_EQ(Layers(), good);
  // Allowed: what they do not replace, a millionth apart, and all of it at once.
  session().Update({.numbers = {{&HapticSettings::viscosity_n_s_per_m, 1.0}}});
  SurfaceLayers close = good;
  close.layer[0].isovalue = 0.6 - 1.001e-6;
  session().Update({.layers = close});
  session().Update({.isovalue = 0.4,
                    .numbers = {{&HapticSettings::stiffness_n_per_mm, 1.0}},
                    .choices = {Choice("free_side", FreeSide::kAbove)},
                    .layers = SurfaceLayers{}});
  EXPECT_EQ(Refusal([&] { session().Update({.layers = good}); }), ErrorKind::kInvalidArgument);
}

TEST_F(SessionLayersTest, ANewVolumeKeepsThoseThatItHasAndNamesTheOthers) {
  session().Update({.layers = SurfaceLayers{{Layer(1, "skin", 0.3), Layer(2, "bone", 0.9)}}});
  VolumeMetadata metadata = session().volume().volume->metadata();  // without a unit, the same file
  metadata.size = Vec3i::Constant(16);
  metadata.value_min = 0.0;
  metadata.value_max = 0.5;
  const BrickDirectory bricks = testing::MakeBricks(
      metadata.size, [](int i, int, int) { return static_cast<float>(i) / 30.0f; });
  const VolumeState kept = session().PublishVolume({.source = "made"}, metadata, bricks);
  ASSERT_EQ(Layers().layer.size(), 1u);
  EXPECT_EQ(Layers().layer[0].name, "skin");
  ASSERT_EQ(kept.volume->metadata().warnings.size(), 1u);
  EXPECT_NE(kept.volume->metadata().warnings[0].find("bone"), std::string::npos);
  // Of other units nothing is known.
  const SurfaceLayers felt = Layers();
  metadata.unit = "HU";
  const VolumeState other = session().PublishVolume({.source = "made"}, metadata, bricks);
  EXPECT_TRUE(Layers().layer.empty());
  EXPECT_NE(other.volume->metadata().warnings[0].find("skin=0.3"), std::string::npos);
  session().Update({.layers = felt});
  metadata.source = "another";
  metadata.size.x() -= 1;
  metadata.warnings.clear();
  session().PublishVolume({.source = "made"}, metadata, bricks);
  EXPECT_EQ(Layers(), felt);
  // The load's own layers must fit.
  const SettingsUpdate far{.layers = SurfaceLayers{{Layer(1, "far", 0.7)}}};
  EXPECT_EQ(Refusal([&] { session().PublishVolume({.source = "made"}, metadata, bricks, 0, far); }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(Layers().layer[0].name, "skin");
  // What layers replace, is refused before a file is read.
  EXPECT_EQ(Refusal([&] { session().Load({.source = "none"}, kQuiet, kNever, {.isovalue = 0.4}); }),
            ErrorKind::kInvalidArgument);
  // A level set is felt from above.
  metadata.is_level_set = true;
  session().PublishVolume({.source = "made"}, metadata, bricks);
  EXPECT_TRUE(Layers().layer.empty());
  // The settings of a load are the new volume's: its side and its range.
  metadata.is_level_set = false;
  session().PublishVolume({.source = "made"}, metadata, bricks, 0,
                          {.layers = SurfaceLayers{{Layer(0, "skin", 0.3)}}});
  EXPECT_EQ(Layers().layer.size(), 1u);
  session().Update({.layers = SurfaceLayers{}});
  metadata.value_min = 2.0;
  metadata.value_max = 3.0;
  session().PublishVolume({.source = "made"}, metadata, bricks, 0, {.isovalue = 2.5});
  EXPECT_EQ(session().settings().settings.isovalue, 2.5);
}

}  // namespace

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
