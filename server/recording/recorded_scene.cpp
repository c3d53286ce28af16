#include "server/recording/recorded_scene.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"

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

}  // namespace palpate
