// A session's volume: another one, or this one edited.
#include <algorithm>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"
#include "server/live_volume/volume_loader.h"
#include "server/log/log.h"
#include "server/session/session.h"
#include "server/session/setting_checks.h"
#include "server/volume/snapshot/brick_memory.h"

namespace palpate {

std::unique_lock<std::mutex> Session::BeginLoad() {
  std::unique_lock loading(load_mutex_, std::try_to_lock);
  if (!loading) {
    throw Error(ErrorKind::kConflict,
                "another volume is being loaded, a recording is being replayed, or the whole "
                "volume is being filtered: try again when it is done");
  }
  return loading;
}

VolumeState Session::Load(const LoadRequest& request, const LoadProgress& progress,
                          const LoadCancelled& cancelled, const SettingsUpdate& settings) {
  const std::unique_lock loading = BeginLoad();
  CheckSettings(request, settings);
  store_.RequireSaved(request.discards_edits);
  std::vector<std::string> warnings;
  if (!request.warning.empty()) warnings.push_back(request.warning);
  MemoryClaim claim = loader_.budget->Claim("the new volume", 0);
  const auto loaded = std::make_shared<const LoadedVolume>(
      LoadBricks(request, progress, cancelled, claim, warnings));
  claim.Resize(0);        // all of it is there
  retired().Add(loaded);  // also if it is not published
  for (const std::string& warning : warnings) LogWarning("{}", warning);
  VolumeMetadata metadata = loaded->metadata;
  metadata.source = request.title.empty() ? request.source : request.title;
  metadata.warnings = WarningsForClients(warnings, request.source);
  metadata.reloadable = request.source_stays && !request.raw && request.frame.value_or(0) == 0 &&
                        request.grid.empty() && request.component.empty();
  const auto tell = [&](std::string_view stage, double fraction) {
    progress(stage, fraction);
    if (cancelled()) throw Error(ErrorKind::kCancelled, "loading was cancelled");
  };
  tell("publishing", 1.0);
  return PublishVolume(request, metadata, loaded->bricks, 0, settings, tell);
}

void Session::CheckSettings(const LoadRequest& request, const SettingsUpdate& settings) const {
  const bool has_isovalue = settings.isovalue || settings.normalized_isovalue;
  if (has_isovalue && (request.isovalue || request.normalized_isovalue)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the load and its settings both name an isovalue: give one of them");
  }
  const std::lock_guard lock(mutex_);
  CheckReplaced(settings_.haptics.layers, settings);
  Changed(*volume_, settings_, WithoutIsovalue(settings));
}

// The claim shrinks as bricks are made, so that nothing is counted twice for long.
LoadedVolume Session::LoadBricks(const LoadRequest& request, const LoadProgress& progress,
                                 const LoadCancelled& cancelled, MemoryClaim& claim,
                                 std::vector<std::string>& warnings) {
  LoadMemory needed;
  const BrickWork work;
  const auto size_known = [&](const Vec3i&, const LoadMemory& memory) {
    needed = memory;
    claim.Resize(memory.Sum());
  };
  const auto tell = [&](std::string_view stage, double fraction) {
    claim.Resize(needed.Sum() - std::min(needed.volume_bytes, work.most_bytes()));
    progress(stage, fraction);
  };
  return loader_.Load(request, tell, cancelled, warnings, size_known);
}

// A level set is first felt from outside, where its values are higher. A density keeps the free
// side of the last density.
FreeSide Session::SideOf(const VolumeMetadata& metadata, const LoadRequest& request,
                         const SettingsUpdate& settings) const {
  if (const auto side = Chosen<FreeSide>(settings, "free_side")) return *side;
  if (request.free_side) return *request.free_side;
  if (metadata.is_level_set) return FreeSide::kAbove;
  const bool was_level_set = volume_->metadata().is_level_set;
  return was_level_set ? side_of_densities_ : settings_.haptics.free_side;
}

void Session::TellBeforeOtherVolume(const HapticSettings& felt, const AffineMap& X_DI,
                                    double isovalue, const std::vector<FeltBall>& fields,
                                    std::shared_ptr<const VolumeSnapshot> volume) const {
  if (!before_other_volume_) return;
  Scene scene;
  scene.volume = std::move(volume);
  scene.settings = felt;
  if (!felt.layers.layer.empty()) isovalue = felt.layers.layer.front().isovalue;
  scene.settings.layers = {};
  FeltTip tip;
  if (felt.tool.ball.empty()) tip.fields = fields;
  FeelSurface(X_DI, DensityOf(*scene.volume, isovalue), 1, tip, scene);
  before_other_volume_(scene.surface);
}

// The settings that will be felt. Tells what the new volume leaves out. Throws for what the load
// itself asks for.
HapticSettings Session::FeltOn(const LoadRequest& request, const SettingsUpdate& settings,
                               const AffineMap& X_DI, VolumeMetadata& metadata) const {
  std::unique_lock lock(mutex_);
  HapticSettings felt = Changed(*volume_, settings_, WithoutIsovalue(settings)).haptics;
  felt.free_side = SideOf(metadata, request, settings);
  const std::string removed = RemoveLayersLocked(settings, metadata, felt.layers);
  lock.unlock();
  if (!removed.empty()) metadata.warnings.push_back(removed);
  if (settings.layers) CheckLayers(felt.layers, metadata);
  CheckHeld(felt, device_);
  const std::string refusal = RefusalOfTip(felt, X_DI);
  if (!refusal.empty() && settings.NamesTip()) Refuse(refusal);
  const std::string left = FitLayers(metadata, felt.free_side, felt.layers);
  if (!left.empty() && settings.layers) Refuse(left);
  if (!left.empty()) metadata.warnings.push_back(left);
  if (!refusal.empty()) metadata.warnings.push_back("a point is felt: " + refusal);
  return felt;
}

VolumeState Session::PublishVolume(const LoadRequest& request, VolumeMetadata metadata,
                                   const BrickDirectory& bricks, std::uint64_t frames_bytes,
                                   const SettingsUpdate& settings, const LoadProgress& progress) {
  CheckSettings(request, settings);
  const VolumePlace registration = PlaceLoaded(request, metadata);
  const AffineMap X_DI = registration.X_DW * metadata.WorldFromIndex();
  const HapticSettings felt = FeltOn(request, settings, X_DI, metadata);
  store_.RequireSaved(request.discards_edits);
  const auto next = std::make_shared<const VolumeSnapshot>(metadata, bricks, 1, 1);
  const auto values = std::make_shared<const VolumeValues>(ValuesOf(*next));
  const double start = ChosenIsovalue(*next, request.isovalue, request.normalized_isovalue,
                                      values->suggested.front().isovalue);
  const double isovalue =
      ChosenIsovalue(*next, settings.isovalue, settings.normalized_isovalue, start);
  std::vector<FeltBall> fields = FieldsFor(felt, settings, X_DI, *next, progress);
  TellBeforeOtherVolume(felt, X_DI, isovalue, fields, next);
  VolumeState state;
  const auto publish = [&](const std::shared_ptr<const VolumeSnapshot>& volume,
                           std::span<const BrickChange>) {
    const std::lock_guard lock(mutex_);
    TakeLoaded(request, settings, registration, volume, isovalue);
    for (FeltBall& field : fields) field.TakeRevisions(*volume);
    SetTipLocked({});
    made_ = std::move(fields);
    values_ = values;
    has_volume_ = true;
    PublishLocked();
    state = VolumeLocked();
    return scene_revision_;
  };
  store_.Replace(metadata, bricks, frames_bytes, request.discards_edits, publish);
  first_load_.Done();  // all listeners have the volume now
  state.unsaved_edits = 0;
  return state;
}

void Session::TakeLoaded(const LoadRequest& request, const SettingsUpdate& settings,
                         const VolumePlace& registration,
                         const std::shared_ptr<const VolumeSnapshot>& volume, double isovalue) {
  const VolumeMetadata& metadata = volume->metadata();
  const bool was_density = has_volume_ && !volume_->metadata().is_level_set;
  const FreeSide side = SideOf(metadata, request, settings);
  if (metadata.is_level_set && was_density) side_of_densities_ = settings_.haptics.free_side;
  settings_ = Changed(*volume, settings_, settings);
  settings_.haptics.free_side = side;
  RemoveLayersLocked(settings, metadata, settings_.haptics.layers);
  volume_ = volume;
  request_ = request;
  is_reshaped_ = false;
  loaded_size_ = metadata.size;
  loaded_X_WI_ = metadata.WorldFromIndex();
  held_isovalue_.reset();
  loaded_range_ = {metadata.value_min, metadata.value_max};
  ++geometry_revision_;
  registration_ = registration;
  X_DI_ = registration.X_DW * metadata.WorldFromIndex();
  FitLayersLocked();
  patient_axes_ = metadata.patient_axes;
  voxels_name_ = RegistrationStore::VoxelsName(metadata, volume->bricks().content_hash());
  if (patient_axes_.empty() && registration_store_) {
    patient_axes_ = registration_store_->FindAxes(voxels_name_);
  }
  settings_.isovalue = isovalue;
  settings_.normalized_isovalue = volume->Normalize(isovalue);
  ++settings_revision_;
  if (registration_store_ && request.device_mm_per_volume_mm) {
    registration_store_->Keep(metadata, registration_);
  }
}

std::uint64_t Session::PublishEdited(const std::shared_ptr<const VolumeSnapshot>& volume,
                                     std::span<const BrickChange> changes) {
  // Nobody else gives fields meanwhile: this is a transaction.
  std::unique_lock lock(mutex_);
  const std::vector<FeltBall> had = tip_.fields;
  std::vector<FeltBall> felt = had, made = made_;
  const bool is_same = volume->loaded_revision() == volume_->loaded_revision() &&
                       volume->bricks().content_hash() == volume_->bricks().content_hash();
  lock.unlock();
  // The same voxels, such as after a replay, have the same fields.
  for (std::vector<FeltBall>* fields : {&felt, &made}) {
    for (FeltBall& field : *fields) {
      if (is_same) field.TakeRevisions(*volume);
    }
  }
  const bool tip_follows = is_same || Follow(felt, *volume);
  if (!is_same && !Follow(made, *volume)) made.clear();
  lock.lock();
  if (volume != volume_) {
    const auto before = std::tuple(volume_, is_reshaped_, X_DI_, registration_, settings_,
                                   held_isovalue_, tip_, made_);
    made_ = std::move(made);
    // An update may have chosen another tip meanwhile.
    if (tip_follows &&
        std::ranges::equal(had, tip_.fields, {}, &FeltBall::field, &FeltBall::field)) {
      for (const FeltBall& field : tip_.fields) retired().Add(field.field());
      tip_.fields = std::move(felt);
    } else {
      SetTipLocked({});
    }
    const bool has_other_lattice = volume->loaded_revision() != volume_->loaded_revision();
    try {
      volume_ = volume;
      if (has_other_lattice) TakeLattice();
      PublishLocked(changes);
    } catch (...) {
      std::tie(volume_, is_reshaped_, X_DI_, registration_, settings_, held_isovalue_, tip_,
               made_) = before;
      throw;
    }
  }
  return scene_revision_;
}

// The volume stays in its place and can still be felt.
void Session::TakeLattice() {
  const VolumeMetadata& metadata = volume_->metadata();
  const AffineMap X_WI = metadata.WorldFromIndex();
  is_reshaped_ = metadata.size != loaded_size_ || X_WI != loaded_X_WI_;
  ++geometry_revision_;
  X_DI_ = registration_.X_DW * metadata.WorldFromIndex();
  registration_.p_DCenter_mm = registration_.X_DW.Apply(VolumeCenterMm(metadata));
  // If the isovalue was clamped to a range, a wider range brings it back.
  const bool was_held = held_isovalue_ && held_isovalue_->second == settings_.isovalue;
  const double wanted = was_held ? held_isovalue_->first : settings_.isovalue;
  settings_.isovalue = std::clamp(wanted, metadata.value_min, metadata.value_max);
  held_isovalue_ = {wanted, settings_.isovalue};
  settings_.normalized_isovalue = volume_->Normalize(settings_.isovalue);
  FitLayersLocked();
  ++settings_revision_;
}

// Those that the load itself asks for stay.
std::string Session::RemoveLayersLocked(const SettingsUpdate& settings,
                                        const VolumeMetadata& metadata,
                                        SurfaceLayers& layers) const {
  if (settings.layers || !has_volume_) return {};
  return RemoveLayersOf(volume_->metadata(), metadata, layers);
}

void Session::FitLayersLocked() {
  HapticSettings& felt = settings_.haptics;
  const std::string left = FitLayers(volume_->metadata(), felt.free_side, felt.layers);
  if (!left.empty()) LogWarning("{}", left);
}

}  // namespace palpate
