// Layers of the settings: what is refused, what another volume keeps, and what the servo gets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
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
    EXPECT_NE(Complaint([&] { session().Update(update); }).find("palpate layer"),
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
  VolumeMetadata metadata;
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
}  // namespace palpate
