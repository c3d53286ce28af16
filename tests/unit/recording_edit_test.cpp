// Changed voxels in recordings: their bytes, what is written when, and what a replay
// makes of them.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "server/recording/bytes.h"
#include "server/recording/edit_codec.h"
#include "server/recording/recorded_volumes.h"
#include "server/recording/voxel_log.h"
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

TEST(EditCodec, RefusesWhatIsNoEdit) {
  EXPECT_EQ(Refusal([] { EncodeEdit({}); }), ErrorKind::kInvalidArgument);
  RecordedEdit large;
  large.bricks.resize(kBricksPerEdit + 1, {0, FilledLeaf(0.0f)});
  EXPECT_EQ(Refusal([&] { EncodeEdit(large); }), ErrorKind::kInvalidArgument);
  const std::string good = EncodeEdit({.bricks = {{1, FilledLeaf(1.0f)}, {2, FilledLeaf(2.0f)}}});
  EXPECT_THROW(DecodeEdit(""), DamagedBytes);
  EXPECT_THROW(DecodeEdit(good.substr(0, good.size() - 1)), DamagedBytes);
  EXPECT_THROW(DecodeEdit(good + '\0'), DamagedBytes);
  EXPECT_THROW(DecodeEdit(EncodeEdit({.bricks = {{2, FilledLeaf(1.0f)}, {2, FilledLeaf(2.0f)}}})),
               DamagedBytes);
  for (const char count : {'\0', '\1', '\3', '\xff'}) {
    std::string bad = good;
    bad[24] = count;
    EXPECT_THROW(DecodeEdit(bad), DamagedBytes);
  }
}

TEST(VoxelLog, WritesWhatTheRecordingLacks) {
  std::mt19937_64 random(1);
  const auto loaded = Gyroid();
  const auto once = WithChanges(*loaded, Carve(*loaded, random));
  const auto twice = WithChanges(*once, Carve(*once, random));
  VoxelLog log;
  RecordedScene scene = SceneOf(*twice);
  const std::vector<RecordedEdit> edits = log.EditsBefore(scene, twice.get());
  ASSERT_EQ(edits.size(), 1u);
  EXPECT_EQ(edits[0].base_revision, 1u);
  EXPECT_EQ(edits[0].volume_revision, 3u);
  EXPECT_FALSE(scene.voxels_missing);
  EXPECT_EQ(HashVolume(*WithEdits(*loaded, edits)), HashVolume(*twice));
  // Nothing new.
  EXPECT_TRUE(log.EditsBefore(scene, twice.get()).empty());
  EXPECT_FALSE(scene.voxels_missing);
  // Its volume was let go: the next one brings both.
  const auto third = WithChanges(*twice, Carve(*twice, random));
  const auto fourth = WithChanges(*third, Carve(*third, random));
  scene = SceneOf(*third);
  EXPECT_TRUE(log.EditsBefore(scene, nullptr).empty());
  EXPECT_TRUE(scene.voxels_missing);
  scene = SceneOf(*fourth);
  const std::vector<RecordedEdit> both = log.EditsBefore(scene, fourth.get());
  ASSERT_EQ(both.size(), 1u);
  EXPECT_EQ(both[0].base_revision, 3u);
  EXPECT_EQ(HashVolume(*WithEdits(*twice, both)), HashVolume(*fourth));
  // Another volume as it was loaded.
  scene = SceneOf(*Gyroid(40, 6));
  EXPECT_TRUE(log.EditsBefore(scene, nullptr).empty());
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
    log.EditsBefore(scene, &loaded);
    scene.volume_revision = 2;
    std::size_t stored = 0;
    for (const RecordedEdit& edit : log.EditsBefore(scene, &changed)) {
      // Parted, so that every part can be written.
      EXPECT_EQ(Refusal([&] { EncodeEdit(edit); }), std::nullopt);
      stored += edit.bricks.size();
    }
    EXPECT_EQ(stored, count == kStored ? static_cast<std::size_t>(kStored) : 0u);
    EXPECT_EQ(scene.voxels_missing, count > kStored);
  }
}

TEST(RecordedVolumes, RefusesEditsThatDoNotFit) {
  const auto volume = Gyroid();
  const auto edit = [](std::uint64_t number, float value) {
    return std::vector<RecordedEdit>{
        {.volume_revision = 2, .bricks = {{number, FilledLeaf(value)}}}};
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
  const RecordedEdit good = log.EditsBefore(scene, edited.get()).front();
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
