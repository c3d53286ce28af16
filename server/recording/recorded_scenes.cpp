#include "server/recording/recorded_scenes.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "common/error/text.h"
#include "server/felt/felt_surface.h"
#include "server/recording/voxel_log.h"

namespace palpate {
namespace {

// These limits are wider than any registration that palpated accepts. Within them, all computed
// numbers stay finite.
constexpr double kFarthestMm = 1e9;
constexpr double kMostVoxelsPerMm = 1e9;

bool IsPlaceOfVolume(const AffineMap& X_DI) {
  const auto within = [](const auto& numbers, double most) {
    return numbers.allFinite() && numbers.cwiseAbs().maxCoeff() <= most;
  };
  return within(X_DI.linear, kFarthestMm) && within(X_DI.translation, kFarthestMm) &&
         within(X_DI.Inverse().linear, kMostVoxelsPerMm);
}

std::vector<Ball> FieldsOf(const Scene& scene) {
  if (scene.tool) return scene.tool->fields;
  if (scene.ball) return {scene.ball->ball};
  return {};
}

// The fields that the tip had go on to the scene's.
FeltTip TipOf(const RecordedScene& recorded, const VolumeSnapshot& volume, FeltTip before) {
  std::vector<FeltBall> fields;
  for (const Ball& ball : recorded.fields) {
    const auto had = std::ranges::find_if(
        before.fields, [&](const FeltBall& field) { return field.ball() == ball; });
    if (had != before.fields.end()) {
      fields.push_back(*had);
      fields.back().Follow(volume);
    } else {
      fields.emplace_back(ball, volume);
    }
  }
  return MakeTip(recorded.tool, std::move(fields), std::move(before.caches));
}

}  // namespace

RecordedScene ToRecorded(const Scene& scene, const VolumeHash& hash, double tick_period_s,
                         const SafetyLimits& safety, const PassivityDevice& device) {
  return {.scene_revision = scene.scene_revision,
          .settings_revision = scene.settings_revision,
          .volume_revision = scene.volume->revision(),
          .loaded_revision = scene.volume->loaded_revision(),
          .geometry_revision = scene.surface.geometry_revision,
          .isovalue = scene.isovalue,
          .normalized_isovalue = scene.surface.sign() * scene.surface.isovalue,
          .settings = scene.settings,
          .X_DI = scene.X_DI(),
          .volume_hash = hash,
          .volume_source = scene.volume->metadata().source,
          .spacing_mm = scene.volume->metadata().spacing_mm,
          .tick_period_s = tick_period_s,
          .safety = safety,
          .forces_off = scene.forces_off,
          .device = device,
          .reloadable = scene.volume->metadata().reloadable,
          .size = scene.volume->size(),
          .value_min = scene.volume->metadata().value_min,
          .value_max = scene.volume->metadata().value_max,
          .is_level_set = scene.volume->metadata().is_level_set,
          .X_WI = scene.volume->metadata().WorldFromIndex(),
          .series_position_frames = scene.series_position_frames,
          .tool = scene.tool ? scene.tool->held : HeldTool(),
          .fields = FieldsOf(scene)};
}

Scene ToScene(const RecordedScene& recorded, std::shared_ptr<const VolumeSnapshot> volume,
              const VolumeHash& hash, FeltTip& tip) {
  if (hash != recorded.volume_hash) {
    throw Error(ErrorKind::kConflict,
                "another volume was recorded: load " + recorded.volume_source + " as it was then");
  }
  if (!recorded.unknown_settings.empty()) {
    throw Error(ErrorKind::kConflict, "recorded with the setting " +
                                          recorded.unknown_settings.front() +
                                          ", which this program does not know: use a newer one");
  }
  if (!IsPlaceOfVolume(recorded.X_DI)) {
    throw Error(ErrorKind::kInvalidArgument, "the recording's place of the volume is no place");
  }
  tip = TipOf(recorded, *volume, std::move(tip));
  Scene scene;
  scene.volume = std::move(volume);
  scene.isovalue = recorded.isovalue;
  scene.settings = recorded.settings;
  FeelSurface(recorded.X_DI, recorded.normalized_isovalue, recorded.geometry_revision, tip, scene);
  scene.settings_revision = recorded.settings_revision;
  scene.scene_revision = recorded.scene_revision;
  scene.forces_off = recorded.forces_off;
  scene.series_position_frames = recorded.series_position_frames;
  return scene;
}

namespace {

std::shared_ptr<const VolumeSnapshot> AtRevision(std::shared_ptr<const VolumeSnapshot> volume,
                                                 const RecordedScene& scene) {
  if (volume->revision() == scene.volume_revision &&
      volume->loaded_revision() == scene.loaded_revision) {
    return volume;
  }
  return std::make_shared<const VolumeSnapshot>(volume->metadata(), volume->bricks(),
                                                scene.volume_revision, scene.loaded_revision);
}

void CheckBrick(const RecordedBrick& brick, std::uint64_t brick_count) {
  const Brick values = brick.values->Floats();
  const bool good =
      brick.number < brick_count &&
      std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
  if (!good) {
    throw Error(ErrorKind::kInvalidArgument,
                "an edit of the recording does not fit the volume: load the one that was recorded");
  }
}

bool IsStoredLattice(const RecordedScene& scene) {
  constexpr auto kMost = static_cast<std::int64_t>(VoxelLog::kMaxBricksPerScene);
  std::int64_t bricks = 1;
  for (const int voxels : scene.size) {
    if (voxels < 2 || voxels > kMost * kBrickEdge) return false;
    bricks *= (voxels + kBrickEdge - 1) / kBrickEdge;
    if (bricks > kMost) return false;
  }
  return std::isfinite(scene.value_max - scene.value_min) && scene.value_min < scene.value_max;
}

// In what the recorded volume and the loaded one differ, if they are of one source.
std::string WhatWasRecorded(const RecordedScene& scene, const VolumeMetadata& loaded) {
  std::string then, now;
  const auto values = [](double least, double greatest, bool is_level_set) {
    return fmt::format("{} {} to {}", is_level_set ? "distances" : "values", NumberText(least),
                       NumberText(greatest));
  };
  if (scene.size != loaded.size || scene.spacing_mm != loaded.spacing_mm) {
    then = ShapeText(scene.size, scene.spacing_mm);
    now = ShapeText(loaded.size, loaded.spacing_mm);
  } else {
    then = values(scene.value_min, scene.value_max, scene.is_level_set);
    now = values(loaded.value_min, loaded.value_max, loaded.is_level_set);
  }
  const std::string source = scene.volume_source;
  if (source != loaded.source) return "another volume was recorded: load " + source;
  return fmt::format(
      "{} is another volume than was recorded: {} then, {} now; the file was "
      "changed, or an earlier version read it otherwise, of which its warnings tell",
      source, then, then == now ? "other ones" : now);
}

}  // namespace

std::shared_ptr<const VolumeSnapshot> WithoutVoxels(const RecordedScene& scene) {
  if (!IsStoredLattice(scene)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the recording is damaged: it cannot hold a volume of this size");
  }
  Brick values;
  const auto background =
      static_cast<float>(scene.is_level_set ? scene.value_max : scene.value_min);
  values.fill(background);
  const LeafPtr leaf = Leaf::Constant(Leaf::Smallest(values)->type(), background);
  VolumeMetadata metadata;
  metadata.size = scene.size;
  metadata.spacing_mm = scene.spacing_mm;
  metadata.value_min = scene.value_min;
  metadata.value_max = scene.value_max;
  metadata.is_level_set = scene.is_level_set;
  metadata.source = scene.volume_source;
  metadata.reloadable = scene.reloadable;
  return std::make_shared<const VolumeSnapshot>(
      metadata, BrickDirectory(scene.size, [&](const Vec3i&) { return leaf; }), 1, 1);
}

std::shared_ptr<const VolumeSnapshot> WithEdits(const VolumeSnapshot& volume,
                                                const std::vector<RecordedEdit>& edits) {
  const BrickDirectory& bricks = volume.bricks();
  const auto count = static_cast<std::uint64_t>(bricks.brick_count().cast<std::int64_t>().prod());
  std::map<std::uint64_t, LeafPtr> changed;  // a damaged recording may name a brick twice
  for (const RecordedEdit& edit : edits) {
    for (const RecordedBrick& brick : edit.bricks) {
      CheckBrick(brick, count);
      changed[brick.number] = brick.values;
    }
  }
  std::vector<BrickChange> changes;
  for (const auto& [number, values] : changed) changes.push_back({bricks.BrickOf(number), values});
  const std::uint64_t revision = edits.front().volume_revision;
  return std::make_shared<const VolumeSnapshot>(volume.metadata(), bricks.With(changes, revision),
                                                revision, volume.loaded_revision());
}

std::shared_ptr<const VolumeSnapshot> RecordedVolumes::Follow(const RecordedScene& scene) {
  error_.reset();
  try {
    return TryFollow(scene, std::exchange(edits_, {}));
  } catch (const Error& error) {
    error_ = error;
    return nullptr;
  }
}

std::shared_ptr<const VolumeSnapshot> RecordedVolumes::TryFollow(const RecordedScene& scene,
                                                                 std::vector<RecordedEdit> edits) {
  const bool is_whole = scene.all_voxels_stored;
  if (loaded_revision_ != scene.loaded_revision || (!volume_ && is_whole)) {
    // Set before the load, so that a failed load is not repeated for every later scene.
    loaded_revision_ = base_revision_ = scene.loaded_revision;
    volume_.reset();
    frames_.clear();
    frame_bricks_ = 0;
    volume_ = load_(scene);
  }
  if (!volume_) {
    throw Error(ErrorKind::kNotFound, "the volume " + scene.volume_source + " was not loaded");
  }
  // Applies the edits even if the voxels are the same afterwards, as after an edit and its undo:
  // the bricks have changed.
  const bool fits = !scene.voxels_missing && !edits.empty() &&
                    edits.front().base_revision == (is_whole ? 0 : base_revision_) &&
                    edits.front().volume_revision == scene.volume_revision;
  if (fits) {
    for (RecordedEdit& edit : edits) Recall(scene, edit);
  }
  const std::shared_ptr<const VolumeSnapshot> changed = fits ? WithEdits(*volume_, edits) : nullptr;
  if (changed && HashVolume(*changed) == scene.volume_hash) {
    volume_ = changed;
    base_revision_ = scene.volume_revision;
    ++applied_edits_;
    if (scene.ShowsFrame()) Keep(scene, edits);
  } else if (HashVolume(*volume_) == scene.volume_hash) {
    if (!edits.empty()) base_revision_ = edits.front().volume_revision;
  } else if (scene.voxels_missing) {
    throw Error(ErrorKind::kConflict, "a change of voxels was too large for the recording");
  } else {
    throw Error(ErrorKind::kConflict, WhatWasRecorded(scene, volume_->metadata()));
  }
  return volume_ = AtRevision(std::move(volume_), scene);
}

void RecordedVolumes::Recall(const RecordedScene& scene, RecordedEdit& edit) const {
  if (edit.known.empty()) return;
  const auto frame = frames_.find(scene.volume_hash);
  if (frame == frames_.end()) {
    throw Error(ErrorKind::kConflict, "a frame of the series is missing in the recording");
  }
  const BrickDirectory& bricks = frame->second->bricks();
  const auto count = static_cast<std::uint64_t>(bricks.brick_count().cast<std::int64_t>().prod());
  std::uint64_t end = 0;
  for (const BrickRun& run : edit.known) {
    if (run.first < end || run.first > count || run.count > count - run.first) {
      throw Error(ErrorKind::kInvalidArgument, "the recording is damaged: bricks out of order");
    }
    end = run.end();
    for (std::uint64_t number = run.first; number < end; ++number) {
      edit.bricks.push_back({number, bricks.At(bricks.BrickOf(number))});
    }
  }
}

void RecordedVolumes::Keep(const RecordedScene& scene, const std::vector<RecordedEdit>& edits) {
  std::uint64_t bricks = 0;
  for (const RecordedEdit& edit : edits) bricks += edit.bricks.size();
  if (frames_.contains(scene.volume_hash) || frame_bricks_ + bricks > kMostFrameBricks) return;
  frames_[scene.volume_hash] = volume_;
  frame_bricks_ += bricks;
}

}  // namespace palpate
