// Changed voxels in recordings: their bytes, what is written when, and what a replay
// makes of them.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "server/recording/recorded_messages.h"
#include "server/recording/recorded_scenes.h"
#include "server/recording/voxel_log.h"
#include "server/volume/snapshot/brick_packer.h"
#include "tests/support/refusal.h"
#include "tests/support/scene_rig.h"

namespace palpate {
namespace {

using testing::Carve;
using testing::FilledLeaf;
using testing::Gyroid;
using testing::Refusal;
using testing::WithChanges;

RecordedScene SceneOf(const VolumeSnapshot& volume) {
  RecordedScene scene;
  scene.volume_revision = volume.revision();
  scene.loaded_revision = volume.loaded_revision();
  scene.volume_hash = HashVolume(volume);
  return scene;
}

// Whatever the types of the bricks, and however many there are.
TEST(BrickPacker, GivesBackWhatWasPutIn) {
  std::mt19937 random(5);
  std::vector<RecordedBrick> bricks;
  for (std::uint64_t n = 0; n < 2000; ++n) {
    Brick values{};
    const int kind = static_cast<int>(random() % 5);
    for (float& value : values) {
      value = kind == 0 ? 7.5f : static_cast<float>(random() % 200) * (kind == 1 ? 0.1f : 1.0f);
    }
    const LeafPtr leaf = kind < 3 ? Leaf::Of(LeafType::kFloat, values) : Leaf::Smallest(values);
    bricks.push_back({3 * n + (kind == 0), leaf});
  }
  const RecordedEdit edit{.base_revision = 1, .volume_revision = 2, .bricks = bricks, .known = {}};
  std::map<std::uint64_t, LeafPtr> read;
  ForEachPart(edit, [&](v1::RecordedVoxels part) {
    EXPECT_LT(part.ByteSizeLong(), 300'000u);
    for (const RecordedBrick& brick : FromProto(std::move(part)).bricks) {
      read[brick.number] = brick.values;
    }
  });
  ASSERT_EQ(read.size(), bricks.size());
  for (const RecordedBrick& brick : bricks) {
    ASSERT_TRUE(read.contains(brick.number));
    EXPECT_TRUE(HaveSameBits(*read[brick.number], *brick.values));
  }
}

TEST(BrickPacker, RefusesWhatItDoesNotMake) {
  BrickPacker packer;
  packer.Add(3, *FilledLeaf(1.0f));
  Brick ramp{};
  ramp[5] = 1.0f;
  packer.Add(4, *Leaf::Of(LeafType::kFloat, ramp));
  const VolumeBricks good = packer.Take();
  const std::function<void(VolumeBricks&)> attacks[] = {
      [](VolumeBricks& bricks) { bricks.zstd_values.pop_back(); },
      [](VolumeBricks& bricks) { bricks.numbers.push_back(5); },
      [](VolumeBricks& bricks) { bricks.numbers.resize(100'000); },
      [](VolumeBricks& bricks) { bricks.type = LeafType::kUint8; },
      [](VolumeBricks& bricks) { bricks.tiles[0].bricks.count = std::uint64_t{1} << 60; },
      [](VolumeBricks& bricks) { bricks.tiles.resize(100'000); },
  };
  int taken = 0;
  UnpackBricks(good, [&](std::uint64_t, const LeafPtr&) { ++taken; });
  EXPECT_EQ(taken, 2);
  for (const auto& attack : attacks) {
    VolumeBricks bad = good;
    attack(bad);
    EXPECT_EQ(Refusal([&] { UnpackBricks(bad, [](std::uint64_t, const LeafPtr&) {}); }),
              ErrorKind::kInvalidArgument);
  }
}

TEST(VoxelLog, WritesWhatTheRecordingLacks) {
  std::mt19937_64 random(1);
  const auto loaded = Gyroid();
  const auto once = WithChanges(*loaded, Carve(*loaded, random));
  const auto twice = WithChanges(*once, Carve(*once, random));
  VoxelLog log;
  RecordedScene scene = SceneOf(*twice);
  const std::optional<RecordedEdit> edit = log.EditBefore(scene, twice.get());
  ASSERT_TRUE(edit);
  EXPECT_EQ(edit->base_revision, 1u);
  EXPECT_EQ(edit->volume_revision, 3u);
  EXPECT_FALSE(scene.voxels_missing);
  EXPECT_EQ(HashVolume(*WithEdits(*loaded, {*edit})), HashVolume(*twice));
  // Nothing new.
  EXPECT_FALSE(log.EditBefore(scene, twice.get()));
  EXPECT_FALSE(scene.voxels_missing);
  // Its volume was let go: the next one brings both.
  const auto third = WithChanges(*twice, Carve(*twice, random));
  const auto fourth = WithChanges(*third, Carve(*third, random));
  scene = SceneOf(*third);
  EXPECT_FALSE(log.EditBefore(scene, nullptr));
  EXPECT_TRUE(scene.voxels_missing);
  scene = SceneOf(*fourth);
  const std::optional<RecordedEdit> both = log.EditBefore(scene, fourth.get());
  ASSERT_TRUE(both);
  EXPECT_EQ(both->base_revision, 3u);
  EXPECT_EQ(HashVolume(*WithEdits(*twice, {*both})), HashVolume(*fourth));
  // Another volume as it was loaded.
  scene = SceneOf(*Gyroid(40, 6));
  EXPECT_FALSE(log.EditBefore(scene, nullptr));
  EXPECT_FALSE(scene.voxels_missing);
}

// README: a change of more than 64 MiB of voxels is declared and not stored.
TEST(VoxelLog, DeclaresMoreThan64MiBOnly) {
  constexpr int kStored = (64 << 20) / (8 * 8 * 8 * static_cast<int>(sizeof(float)));
  VolumeMetadata metadata;
  metadata.size = Vec3i(8, 8, 8 * (kStored + 1));
  metadata.value_max = 1.0;
  // One brick everywhere: it costs nothing.
  const LeafPtr before = Leaf::Constant(LeafType::kFloat, 0.0f), after = FilledLeaf(1.0f);
  const BrickDirectory bricks(metadata.size, [&](const Vec3i&) { return before; });
  const VolumeSnapshot loaded(metadata, bricks.AllChangedAt(1), 1, 1);
  for (const int count : {kStored, kStored + 1}) {
    std::vector<BrickChange> changes;
    for (int n = 0; n < count; ++n) changes.push_back({Vec3i(0, 0, n), after});
    const VolumeSnapshot changed(metadata, loaded.bricks().With(changes, 2), 2, 1);
    VoxelLog log;
    RecordedScene scene;
    scene.loaded_revision = 1;
    scene.volume_revision = 1;
    log.EditBefore(scene, &loaded);
    scene.volume_revision = 2;
    const std::optional<RecordedEdit> edit = log.EditBefore(scene, &changed);
    const std::size_t stored = edit ? edit->bricks.size() : 0;
    EXPECT_EQ(stored, count == kStored ? static_cast<std::size_t>(kStored) : 0u);
    EXPECT_EQ(scene.voxels_missing, count > kStored);
  }
}

TEST(RecordedVolumes, RefusesEditsThatDoNotFit) {
  const auto volume = Gyroid();
  const auto edit = [](std::uint64_t number, float value) {
    return std::vector<RecordedEdit>{
        {.volume_revision = 2, .bricks = {{number, FilledLeaf(value)}}, .known = {}}};
  };
  EXPECT_EQ(Refusal([&] { WithEdits(*volume, edit(215, 0.0f)); }), std::nullopt);
  for (const auto& bad : {edit(216, 0.0f), edit(~0ull, 0.0f), edit(0, std::nanf("")),
                          edit(0, std::numeric_limits<float>::infinity())}) {
    EXPECT_EQ(Refusal([&] { WithEdits(*volume, bad); }), ErrorKind::kInvalidArgument);
  }
}

// Carried into the follower by another base than it has, or with other voxels.
TEST(RecordedVolumes, TrustsHashesOnly) {
  std::mt19937_64 random(1);
  const auto loaded = Gyroid();
  const auto edited = WithChanges(*loaded, Carve(*loaded, random));
  VoxelLog log;
  RecordedScene scene = SceneOf(*edited);
  const RecordedEdit good = *log.EditBefore(scene, edited.get());
  int loads = 0;
  RecordedVolumes follower([&](const RecordedScene&) {
    ++loads;
    return loaded;
  });
  RecordedEdit bad = good;
  bad.base_revision = 17;
  follower.Take(bad);
  EXPECT_EQ(follower.Follow(scene), nullptr);
  ASSERT_TRUE(follower.error());
  bad = good;
  bad.bricks.pop_back();
  follower.Take(bad);
  EXPECT_EQ(follower.Follow(scene), nullptr);
  EXPECT_EQ(follower.Follow(scene), nullptr);  // without any
  follower.Take(good);
  const auto volume = follower.Follow(scene);
  ASSERT_NE(volume, nullptr);
  EXPECT_FALSE(follower.error());
  EXPECT_EQ(volume->revision(), 2u);
  EXPECT_EQ(HashVolume(*volume), HashVolume(*edited));
  EXPECT_EQ(follower.applied_edits(), 1u);
  EXPECT_EQ(loads, 1);
}

// The same file, read otherwise.
TEST(RecordedVolumes, SaysInWhatTheVolumeDiffers) {
  const auto loaded = Gyroid();
  const auto error = [&](const std::function<void(RecordedScene&)>& change) {
    RecordedVolumes follower([&](const RecordedScene&) { return loaded; });
    RecordedScene scene = SceneOf(*loaded);
    scene.volume_hash.low ^= 1;
    const VolumeMetadata& metadata = loaded->metadata();
    std::tie(scene.size, scene.spacing_mm, scene.value_min, scene.value_max, scene.volume_source) =
        std::tie(metadata.size, metadata.spacing_mm, metadata.value_min, metadata.value_max,
                 metadata.source);
    change(scene);
    EXPECT_EQ(follower.Follow(scene), nullptr);
    return std::string(follower.error()->what());
  };
  EXPECT_NE(error([](RecordedScene& s) { s.value_max = 3072.5; }).find("3072.5"),
            std::string::npos);
  EXPECT_NE(error([](RecordedScene& s) { s.size.z() = 77; }).find("77 voxels"), std::string::npos);
  EXPECT_EQ(error([](RecordedScene& s) { s.volume_source = "/other"; }),
            "another volume was recorded: load /other");
}

TEST(RecordedVolumes, AFailedLoadIsNotTriedAgain) {
  int loads = 0;
  RecordedVolumes follower([&](const RecordedScene&) -> std::shared_ptr<const VolumeSnapshot> {
    ++loads;
    throw Error(ErrorKind::kNotFound, "gone");
  });
  const RecordedScene scene = SceneOf(*Gyroid());
  EXPECT_EQ(follower.Follow(scene), nullptr);
  EXPECT_EQ(follower.Follow(scene), nullptr);
  EXPECT_EQ(follower.error()->kind(), ErrorKind::kNotFound);
  EXPECT_EQ(loads, 1);
}

}  // namespace
}  // namespace palpate
