// A recording holds enough: its ticks, computed again, give the same bits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "server/recording/replayer.h"
#include "server/servo/servo_memory.h"
#include "server/session/series/series_player.h"
#include "tests/support/refusal.h"
#include "tests/support/scene_rig.h"

namespace palpate {
namespace {

using testing::Carve;
using testing::Gyroid;
using testing::MemoryOutput;
using testing::SceneRig;

class RecordingReplay : public ::testing::Test {
 protected:
  std::unique_ptr<RecordingOutput> Output() { return std::make_unique<MemoryOutput>(bytes_); }

  using Change = std::function<void(RecordedItem&)>;

  // Hands over all items, changed by `change`.
  Replayer ReplayLoading(const RecordedVolumeLoader& load, const Change& change = AsItIs) {
    Replayer replayer(load);
    RecordingReader reader = testing::ReadBytes(*bytes_);
    while (std::optional<RecordedItem> item = reader.Next()) {
      change(*item);
      replayer.Take(*item);
    }
    EXPECT_TRUE(reader.complete()) << reader.stopped_because();
    return replayer;
  }
  // Every load gives `volume`, whatever it is.
  Replayer Replay(std::shared_ptr<const VolumeSnapshot> volume, const Change& change = AsItIs) {
    return ReplayLoading([volume](const RecordedScene&) { return volume; }, change);
  }
  static void AsItIs(RecordedItem&) {}

  // That of a recording which begins with it.
  RecordedScene SceneOf(const std::shared_ptr<const VolumeSnapshot>& volume) {
    SceneRig rig(volume);
    rig.Record(Output());
    rig.Run(100);
    rig.Stop();
    RecordingReader reader = testing::ReadBytes(*bytes_);
    return std::get<RecordedScene>(*reader.Next());
  }
  static void ExpectNoDifference(const Replayer& replayer) {
    EXPECT_EQ(replayer.counts().differing, 0u);
    EXPECT_EQ(replayer.counts().differing_keyframes, 0u);
    if (const auto& first = replayer.first_difference()) {
      ADD_FAILURE() << "tick " << first->tick << " " << first->field << ": " << first->recorded
                    << ", computed " << first->computed;
    }
  }

  std::shared_ptr<std::string> bytes_ = std::make_shared<std::string>();
  std::mt19937_64 random_{1};
};

TEST_F(RecordingReplay, GivesTheSameBitsThroughSettingsEditsAndFaults) {
  const auto volume = Gyroid();
  SceneRig rig(volume, SimulatedDeviceSpec(50.0));
  rig.Record(Output());
  for (int n = 0; n < 8; ++n) {
    HapticSettings settings = rig.settings();
    settings.stiffness_n_per_mm = 0.3 + 0.1 * n;
    settings.force_shading = n % 2 == 1;
    settings.passivity_control = n >= 4;
    settings.pop_force_n = n == 6 ? 2.5 : 0.0;
    settings.magnet_force_n = n == 3 ? 0.5 : 0.0;
    settings.free_side = n == 5 ? FreeSide::kAbove : FreeSide::kBelow;
    rig.Set(0.45 + 0.01 * n, settings);
    rig.Run(500);
    rig.Miss(n);
    rig.Run(100);
    if (n >= 2) {
      rig.SetBall(n == 7 ? std::nullopt : std::optional(3.4 + 1.7 * n), n == 5);
    }
    if (n % 4 == 0) {
      rig.SetTool({.name = "rod",
                   .ball = {{Vec3::Zero(), 3.0}, {Vec3(0, 0, 12), 3.0}, {Vec3(0, 0, 30), 0.0}}});
    }
    for (int edits = 0; edits < 5; ++edits) {
      rig.Edit(Carve(*rig.volume(), random_));
      if (edits % 2 == 0) rig.Run(30);  // no tick alone uses the others
    }
    rig.Run(300);
    if (n == 2) {
      rig.device().Stop();
      rig.Run(50);
      rig.device().Start();
    }
    rig.SetForcesOff(n % 3 == 2);
  }
  rig.recorder().Mark("end");
  rig.Run(10);
  const RecorderReport report = rig.Stop();
  const Replayer replayer = Replay(volume);
  ExpectNoDifference(replayer);
  const ReplayCounts& counts = replayer.counts();
  EXPECT_EQ(counts.ticks, report.counts.ticks);
  EXPECT_EQ(counts.compared, counts.ticks);
  EXPECT_EQ(counts.edits, 8u * 3u);
  EXPECT_EQ(counts.markers, 1u);
  EXPECT_GE(counts.keyframes, counts.ticks / 1000 - 1);
  EXPECT_GT(counts.contacts, counts.ticks / 8);
}

// Edits of before are part of it, and it need not begin with the first tick.
TEST_F(RecordingReplay, BeginsAnywhere) {
  const auto volume = Gyroid();
  SceneRig rig(volume);
  rig.Run(1000);
  for (int n = 0; n < 20; ++n) rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(1000 + 5);
  rig.Record(Output());
  rig.Run(2000);
  rig.Stop();
  const Replayer replayer = Replay(volume);
  ExpectNoDifference(replayer);
  EXPECT_EQ(replayer.counts().edits, 1u);
  EXPECT_EQ(replayer.counts().without_start, 2048u - 2005u);
  EXPECT_EQ(replayer.counts().compared, 2000u - (2048u - 2005u));
  EXPECT_GT(replayer.counts().contacts, 200u);
}

TEST_F(RecordingReplay, GoesOnAfterEachGapThoughEditsFellIntoIt) {
  const auto volume = Gyroid();
  SceneRig rig(volume);
  rig.Record(Output());
  constexpr int kGaps = 5;
  for (int n = 0; n < kGaps; ++n) {
    rig.Run(700);
    rig.Edit(Carve(*rig.volume(), random_));
    rig.Run(10);
    rig.Edit(Carve(*rig.volume(), random_));
    rig.Run(333, true);
    rig.Edit(Carve(*rig.volume(), random_));
    rig.Run(100, true);
  }
  rig.Run(500);
  rig.Stop();
  const Replayer replayer = Replay(volume);
  ExpectNoDifference(replayer);
  const ReplayCounts& counts = replayer.counts();
  EXPECT_EQ(counts.gaps, static_cast<std::uint64_t>(kGaps));
  EXPECT_EQ(counts.lost_ticks, kGaps * 433u);
  EXPECT_LE(counts.without_start, kGaps * (kKeyframeTicks - 1));
  EXPECT_EQ(counts.compared + counts.without_start, counts.ticks);
}

TEST_F(RecordingReplay, FollowsAnotherVolumeThatIsLoaded) {
  const auto first = Gyroid(), second = Gyroid(40, 3);
  SceneRig rig(first);
  rig.Record(Output());
  rig.Run(500);
  rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(500);
  ASSERT_EQ(rig.next_revision(), 3u);
  rig.Load(second);
  rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(1000);
  rig.Stop();
  int loads = 0;
  const Replayer replayer = ReplayLoading([&](const RecordedScene& scene) {
    ++loads;
    return scene.loaded_revision == 1 ? first : second;
  });
  ExpectNoDifference(replayer);
  EXPECT_EQ(loads, 2);
  EXPECT_EQ(replayer.counts().compared, 2000u);
  EXPECT_EQ(replayer.counts().edits, 2u);
}

TEST_F(RecordingReplay, SaysWhereVoxelsAreMissingAndGoesOnWhereItCan) {
  const auto volume = Gyroid(264);  // 33³ bricks are more than a recording takes
  SceneRig rig(volume);
  rig.Record(Output());
  rig.Run(500);
  const std::vector<BrickChange> one = Carve(*rig.volume(), random_);
  rig.Edit(one);
  rig.Run(500);
  const auto before = rig.volume();
  std::vector<BrickChange> all, back;
  for (std::uint64_t n = 0; n < 33 * 33 * 33; ++n) {
    const Vec3i brick = before->bricks().BrickOf(n);
    Brick values = before->bricks().At(brick)->Floats();
    for (float& value : values) value *= 0.9f;
    all.push_back({brick, Leaf::Of(LeafType::kFloat, values)});
    back.push_back({brick, before->bricks().At(brick)});
  }
  rig.Edit(all);
  rig.Run(300);
  rig.Edit(one);  // on top of what the recording does not have
  rig.Run(300);
  rig.Edit(back);
  rig.Run(1500);
  rig.Stop();
  EXPECT_LT(bytes_->size(), 2u << 20);
  const Replayer replayer = Replay(volume);
  ExpectNoDifference(replayer);
  const ReplayCounts& counts = replayer.counts();
  EXPECT_EQ(counts.without_volume, 600u);
  EXPECT_GE(counts.compared, 1000u + 500u);
  EXPECT_EQ(counts.compared + counts.without_volume + counts.without_start, counts.ticks);
  ASSERT_TRUE(replayer.volume_error());
  EXPECT_NE(std::string(replayer.volume_error()->what()).find("too large"), std::string::npos);
}

TEST_F(RecordingReplay, AnotherVolumeGivesNoTicks) {
  SceneRig rig(Gyroid());
  rig.Record(Output());
  rig.Run(1000);
  rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(1000);
  rig.Stop();
  // Greater, so that the edit has a place in it: it is known by its voxels.
  const Replayer other = Replay(Gyroid(56));
  EXPECT_EQ(other.counts().compared, 0u);
  EXPECT_EQ(other.counts().without_volume, 2000u);
  ASSERT_TRUE(other.volume_error());
  EXPECT_EQ(other.volume_error()->kind(), ErrorKind::kConflict) << other.volume_error()->what();
  EXPECT_EQ(Replay(nullptr).volume_error()->kind(), ErrorKind::kNotFound);
}

// One number of one sample, one voxel of one edit.
TEST_F(RecordingReplay, SeesWhatWasChanged) {
  const auto volume = Gyroid();
  SceneRig rig(volume);
  rig.Record(Output());
  rig.Run(3000);
  rig.Stop();
  const Replayer replayer = Replay(volume, [](RecordedItem& item) {
    auto* samples = std::get_if<RecordedSamples>(&item);
    if (!samples) return;
    for (TickSample& sample : *samples) {
      if (sample.tick == 1234) sample.force_n[1] = std::nextafter(sample.force_n[1], 100.0);
    }
  });
  EXPECT_EQ(replayer.counts().differing, 1u);
  ASSERT_TRUE(replayer.first_difference());
  EXPECT_EQ(replayer.first_difference()->tick, 1234u);
  EXPECT_EQ(replayer.first_difference()->field, "force_y_n");
}

TEST_F(RecordingReplay, ScenesThatCannotBeAreRefused) {
  const auto volume = Gyroid();
  const RecordedScene good = SceneOf(volume);
  const VolumeHash hash = HashVolume(*volume), other{hash.high, hash.low + 1};
  FeltTip none;
  const auto refusal_of = [&](const std::function<void(RecordedScene&)>& change) {
    RecordedScene scene = good;
    change(scene);
    none = {};
    return testing::Refusal([&] { ToScene(scene, volume, hash, none); });
  };
  const auto invalid = ErrorKind::kInvalidArgument;
  EXPECT_EQ(refusal_of([](RecordedScene&) {}), std::nullopt);
  EXPECT_EQ(testing::Refusal([&] { ToScene(good, volume, other, none); }), ErrorKind::kConflict);
  EXPECT_EQ(refusal_of([](RecordedScene& bad) { bad.unknown_settings = {"texture_mm"}; }),
            ErrorKind::kConflict);
  for (const double scale : {0.0, 1e-140, 1e140}) {
    EXPECT_EQ(refusal_of([&](RecordedScene& bad) { bad.X_DI.linear *= scale; }), invalid) << scale;
  }
  EXPECT_EQ(refusal_of([](RecordedScene& bad) { bad.X_DI.translation.y() = -1e10; }), invalid);
  RecordedScene bad = good;
  bad.tick_period_s = 2e-3;
  Replayer replayer([&](const RecordedScene&) { return volume; });
  replayer.Take(bad);
  EXPECT_TRUE(replayer.volume_error());
  EXPECT_EQ(testing::Refusal([&] { replayer.Take(RecordedKeyframe{.tick = 0, .state = "old"}); }),
            ErrorKind::kConflict);
}

// Passivity control as that device needs it, and not as an Omni does.
TEST_F(RecordingReplay, GivesTheSameBitsOfAnotherDevice) {
  const auto volume = Gyroid();
  DeviceDescription spec = SimulatedDeviceSpec();
  spec.position_resolution_mm = 25.4 / 400.0;
  spec.max_force_n = 2.0;
  SceneRig rig(volume, spec);
  HapticSettings settings = rig.settings();
  settings.passivity_control = true;
  settings.stiffness_n_per_mm = 2.0;
  rig.Set(0.47, settings);
  rig.Record(Output());
  rig.Run(6000);
  rig.Stop();
  const Replayer replayer = Replay(volume);
  ExpectNoDifference(replayer);
  EXPECT_EQ(replayer.counts().compared, 6000u);
  const Replayer as_omni = Replay(volume, [](RecordedItem& item) {
    if (auto* scene = std::get_if<RecordedScene>(&item)) scene->device = {};
  });
  EXPECT_GT(as_omni.counts().differing, 100u);
}

std::shared_ptr<const VolumeSnapshot> NotReloadable(const VolumeSnapshot& volume) {
  VolumeMetadata metadata = volume.metadata();
  metadata.source = "upload:a.nrrd";
  metadata.reloadable = false;
  return std::make_shared<const VolumeSnapshot>(metadata, volume.bricks(), volume.revision(),
                                                volume.loaded_revision());
}

// An upload, whose file is gone, and a series: no file gives them again.
TEST_F(RecordingReplay, HoldsVolumesThatNoFileGives) {
  const auto first = NotReloadable(*Gyroid()), second = NotReloadable(*Gyroid(40, 4));
  SceneRig rig(first);
  rig.Run(300);
  rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(300);
  rig.Record(Output());
  rig.Run(500);
  rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(500);
  ASSERT_EQ(rig.next_revision(), 4u);
  rig.Load(second);
  const auto last = testing::MakeVolume(second->size(), [](int i, int j, int k) {
    return std::sin(0.3 * i) * std::cos(0.2 * j) + std::sin(0.1 * k);
  });
  for (int n = 0; n < 20; ++n) {  // a series, interpolated
    rig.Run(50);
    rig.Edit(rig.volume()->bricks().ChangesTo(Blend(second->bricks(), last->bricks(), 0.05 * n)));
  }
  rig.Run(500);
  const RecorderReport report = rig.Stop();
  EXPECT_EQ(report.left_out, "");
  const Replayer replayer = ReplayLoading([](const RecordedScene& scene) {
    EXPECT_TRUE(scene.all_voxels_stored);
    return WithoutVoxels(scene);
  });
  ExpectNoDifference(replayer);
  const ReplayCounts& counts = replayer.counts();
  EXPECT_EQ(counts.without_volume + counts.without_scene, 0u);
  EXPECT_EQ(counts.compared + counts.without_start, counts.ticks);
  EXPECT_EQ(counts.ticks, 2500u);
  EXPECT_GT(counts.contacts, 200u);
}

// Frames that come again are stored once, and ticks say which one they felt.
TEST_F(RecordingReplay, HoldsEachFrameOfASeriesOnce) {
  const auto first = NotReloadable(*Gyroid());
  const auto last = testing::MakeVolume(first->size(), [](int i, int j, int k) {
    return std::sin(0.3 * i) * std::cos(0.2 * j) + std::sin(0.1 * k);
  });
  std::vector<BrickDirectory> frames = {first->bricks()};
  for (const double share : {0.1, 0.2, 0.3}) {
    frames.push_back(Blend(first->bricks(), last->bricks(), share));
  }
  SceneRig rig(first);
  rig.Record(Output());
  for (int n = 0; n < 20; ++n) {
    rig.ShowFrame(n % 4, frames[n % 4]);
    rig.Run(125);
    if (n == 9) rig.Edit(Carve(*rig.volume(), random_));  // is no frame
    rig.Run(125);
  }
  rig.Run(1000);
  rig.Stop();
  RecordingReader reader = testing::ReadBytes(*bytes_);
  const std::vector<RecordedItem> items = testing::ReadAll(reader);
  for (const TickSample& sample : testing::SamplesIn(items)) {
    const std::uint64_t shown = std::min<std::uint64_t>(sample.tick / 250, 19);
    EXPECT_EQ(sample.series_position_frames, static_cast<double>(shown % 4)) << sample.tick;
  }
  std::set<std::uint64_t> stored, known;
  for (const RecordedEdit& edit : testing::Only<RecordedEdit>(items)) {
    (edit.known.empty() ? stored : known).insert(edit.tick);
  }
  EXPECT_EQ(stored, (std::set<std::uint64_t>{0, 250, 500, 750, 9 * 250 + 125}));
  EXPECT_EQ(known.size(), 16u);
  const auto load = [](const RecordedScene& scene) { return WithoutVoxels(scene); };
  const Replayer replayer = ReplayLoading(load);
  ExpectNoDifference(replayer);
  EXPECT_EQ(replayer.counts().compared, 6000u);
  EXPECT_EQ(replayer.counts().edits, 21u);
  // Without the frame that it came from, a scene has no volume.
  const Replayer without = ReplayLoading(load, [](RecordedItem& item) {
    auto* scene = std::get_if<RecordedScene>(&item);
    if (scene && scene->tick < 2000) scene->series_position_frames.reset();
  });
  EXPECT_GT(without.counts().without_volume, 0u);
  EXPECT_EQ(without.volume_error()->kind(), ErrorKind::kConflict);
}

TEST_F(RecordingReplay, SaysAtOnceThatAVolumeIsTooLarge) {
  const auto volume = NotReloadable(*Gyroid(264));
  SceneRig rig(volume);
  rig.Record(Output());
  EXPECT_NE(rig.recorder().report().left_out.find("upload:a.nrrd"), std::string::npos);
  rig.Run(500);
  rig.Edit(Carve(*rig.volume(), random_));
  rig.Run(500);
  EXPECT_NE(rig.Stop().left_out, "");
  EXPECT_LT(bytes_->size(), 2u << 20);
  // Whoever has the file can still compute it again, edits and all.
  const Replayer replayer = Replay(volume);
  ExpectNoDifference(replayer);
  EXPECT_EQ(replayer.counts().compared, 1000u);
}

TEST_F(RecordingReplay, StoredVolumesThatCannotBeAreRefused) {
  RecordedScene good;
  good.size = Vec3i(40, 30, 20);
  good.value_max = 1.0;
  EXPECT_EQ(testing::Refusal([&] { WithoutVoxels(good); }), std::nullopt);
  const auto refused = ErrorKind::kInvalidArgument;
  for (const Vec3i& size : {Vec3i(40, 1, 20), Vec3i(-8, -8, 20), Vec3i(1 << 30, 1 << 30, 1 << 30),
                            Vec3i(257, 257, 257)}) {
    RecordedScene bad = good;
    bad.size = size;
    EXPECT_EQ(testing::Refusal([&] { WithoutVoxels(bad); }), refused) << size.transpose();
  }
  for (const double max : {0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    RecordedScene bad = good;
    bad.value_max = max;
    EXPECT_EQ(testing::Refusal([&] { WithoutVoxels(bad); }), refused) << max;
  }
}

// As somebody might write them into a file with good checksums.
TEST_F(RecordingReplay, StatesThatNoServoHasAreRefused) {
  const auto volume = Gyroid();
  SceneRig rig(volume);
  rig.Record(Output());
  rig.Run(3000);
  rig.Stop();
  const auto replay = [&](const std::function<void(Place&)>& attack) {
    Replay(volume, [&](RecordedItem& item) {
      auto* keyframe = std::get_if<RecordedKeyframe>(&item);
      if (!keyframe) return;
      ServoMemory memory;
      EXPECT_TRUE(Load(keyframe->state, memory));
      Proxy& proxy = memory.renderer.proxy;
      if (proxy.placed && proxy.place.kind == Place::Kind::kSimplex) attack(proxy.place);
      keyframe->state = Save(memory).view();
    });
  };
  const std::vector<std::pair<const char*, std::function<void(Place&)>>> attacks = {
      {"weights below 0", [](Place& place) { place.carrier.weight.fill(-1.0); }},
      {"weights that are no numbers",
       [](Place& place) { place.carrier.weight.fill(std::numeric_limits<double>::quiet_NaN()); }},
      {"no vertices", [](Place& place) { place.carrier.count = 0; }},
      {"a tetrahedron that no cell has", [](Place& place) { place.tetrahedron = 31; }},
  };
  EXPECT_EQ(testing::Refusal([&] { replay([](Place&) {}); }), std::nullopt);
  for (const auto& [name, attack] : attacks) {
    // Lambdas of clang 14 capture no part of a binding by reference.
    EXPECT_EQ(testing::Refusal([&, &attack = attack] { replay(attack); }), ErrorKind::kConflict)
        << name;
  }
}

// The servo keeps places and cells for as long as their revisions are the same.
TEST_F(RecordingReplay, ScenesThatContradictEachOtherAreRefused) {
  const auto volume = Gyroid();
  const RecordedScene good = SceneOf(volume);
  const auto refusal_of = [&](const std::function<void(RecordedScene&)>& change) {
    Replayer replayer([&](const RecordedScene&) { return volume; });
    replayer.Take(good);
    RecordedScene next = good;
    ++next.scene_revision;
    change(next);
    return testing::Refusal([&] { replayer.Take(next); });
  };
  EXPECT_EQ(refusal_of([](RecordedScene& next) { next.isovalue += 1.0; }), std::nullopt);
  EXPECT_EQ(refusal_of([](RecordedScene& next) {
              ++next.geometry_revision;
              next.settings.method = DecompositionMethod::kBcc;
            }),
            std::nullopt);
  const auto contradicts = ErrorKind::kInvalidArgument;
  EXPECT_EQ(
      refusal_of([](RecordedScene& next) { next.settings.method = DecompositionMethod::kBcc; }),
      contradicts);
  EXPECT_EQ(refusal_of([](RecordedScene& next) { next.X_DI.translation.x() += 1.0; }), contradicts);
  EXPECT_EQ(refusal_of([](RecordedScene& next) { next.fields = {Ball{2.0}}; }), contradicts);
  EXPECT_EQ(refusal_of([](RecordedScene& next) { --next.geometry_revision; }), contradicts);
  EXPECT_EQ(refusal_of([](RecordedScene& next) { --next.volume_revision; }), contradicts);
  EXPECT_EQ(refusal_of([](RecordedScene& next) { ++next.volume_hash.low; }), contradicts);
}

}  // namespace
}  // namespace palpate
