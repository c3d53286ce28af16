#include "server/recording/replayer.h"

#include <array>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

#include "server/pump/pose_of.h"
#include "server/recording/recorded_scenes.h"
#include "server/recording/sample_fields.h"

namespace palpate {
namespace {

constexpr std::size_t kMaxFields = 80;

template <class Field>
std::string Text(const Field& field) {
  if constexpr (std::is_enum_v<Field>) {
    return std::to_string(static_cast<int>(field));
  } else if constexpr (std::is_floating_point_v<Field>) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.17g", field);
    return digits;
  } else {
    return std::to_string(field);
  }
}

// Positions and decompositions are kept while a revision stays the same. So equal revisions must
// mean equal contents.
void CheckOrder(const RecordedScene& before, const RecordedScene& scene) {
  const bool same_geometry = scene.geometry_revision == before.geometry_revision;
  const bool same_volume = scene.volume_revision == before.volume_revision;
  const bool good = scene.geometry_revision >= before.geometry_revision &&
                    scene.volume_revision >= before.volume_revision &&
                    (!same_geometry || (scene.settings.method == before.settings.method &&
                                        scene.X_DI == before.X_DI && scene.tool == before.tool &&
                                        scene.fields == before.fields &&
                                        scene.loaded_revision == before.loaded_revision)) &&
                    (!same_volume || scene.volume_hash == before.volume_hash);
  if (good) return;
  throw Error(ErrorKind::kInvalidArgument,
              "the recording is damaged: its scenes contradict each other");
}

}  // namespace

void Replayer::Take(const RecordedItem& item) {
  if (const auto* samples = std::get_if<RecordedSamples>(&item)) Take(*samples);
  if (const auto* edit = std::get_if<RecordedEdit>(&item)) follower_.Take(*edit);
  if (const auto* scene = std::get_if<RecordedScene>(&item)) Begin(*scene);
  if (const auto* keyframe = std::get_if<RecordedKeyframe>(&item)) Resume(*keyframe);
  if (std::holds_alternative<RecordedEvent>(item)) ++counts_.markers;
  if (const auto* gap = std::get_if<RecordedGap>(&item)) {
    ++counts_.gaps;
    counts_.lost_ticks += gap->last_tick - gap->first_tick + 1;
    in_step_ = false;
  }
}

void Replayer::Begin(const RecordedScene& recorded) {
  ++counts_.scenes;
  if (last_) CheckOrder(*last_, recorded);
  last_ = recorded;
  if (!computation_ || !(recorded.safety == safety_) || !(recorded.device == device_)) {
    computation_.emplace(recorded.safety, recorded.device);
    cells_ = std::make_unique<CellCache>();
    safety_ = recorded.safety;
    device_ = recorded.device;
    in_step_ = false;
  }
  std::shared_ptr<const VolumeSnapshot> volume = follower_.Follow(recorded);
  counts_.edits = follower_.applied_edits();
  scene_.volume.reset();
  if (!volume) {
    volume_error_ = follower_.error();
    return;
  }
  try {
    if (recorded.tick_period_s != kTickPeriodS) {
      throw Error(ErrorKind::kConflict, "the recording has another tick rate than this program");
    }
    scene_ = ToScene(recorded, std::move(volume), recorded.volume_hash, tip_);
  } catch (const Error& error) {
    volume_error_ = error;
  }
}

void Replayer::Resume(const RecordedKeyframe& keyframe) {
  if (!computation_) return;  // nothing can be computed before the first scene
  if (in_step_) {
    ++counts_.keyframes;
    if (computation_->Keyframe().view() == keyframe.state) return;
    ++counts_.differing_keyframes;
  }
  in_step_ = computation_->Resume(keyframe.state) && computation_->next_tick() == keyframe.tick;
  if (!in_step_) {
    throw Error(ErrorKind::kConflict,
                "recorded by another version of Palpate, whose state this version cannot use: "
                "replay with the other version");
  }
}

void Replayer::Take(const RecordedSamples& samples) {
  for (const TickSample& sample : samples) Take(sample);
}

void Replayer::Take(const TickSample& sample) {
  ++counts_.ticks;
  const bool has_scene = last_ && sample.scene_revision == last_->scene_revision;
  if (has_scene && scene_.volume && in_step_) {
    ++counts_.compared;
    counts_.contacts += sample.contact;
    TickSample computed = computation_->Run(scene_, computation_->InputOf(sample));
    AddScpV(scene_, *cells_, computed);
    computed.time_ns = sample.time_ns;
    computed.update_ns = sample.update_ns;
    Compare(sample, computed);
    return;
  }
  in_step_ = false;
  ++(!has_scene       ? counts_.without_scene
     : !scene_.volume ? counts_.without_volume
                      : counts_.without_start);
}

void Replayer::Compare(const TickSample& recorded, const TickSample& computed) {
  std::array<const void*, kMaxFields> fields{};
  std::size_t n = 0;
  VisitFields(computed, [&](std::string_view, const auto& field) { fields.at(n++) = &field; });
  n = 0;
  bool same = true;
  VisitFields(recorded, [&](std::string_view name, const auto& field) {
    const void* other = fields[n++];
    if (std::memcmp(other, &field, sizeof field) == 0) return;
    same = false;
    if (difference_) return;
    auto computed_field = field;
    std::memcpy(&computed_field, other, sizeof field);
    difference_ = {recorded.tick, std::string(name), Text(field), Text(computed_field)};
  });
  counts_.differing += !same;
}

}  // namespace palpate
