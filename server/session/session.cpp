#include "server/session/session.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"
#include "server/live_volume/load_warnings.h"
#include "server/log/log.h"
#include "server/session/held_tool.h"
#include "server/session/layers.h"
#include "server/session/range.h"
#include "server/volume/snapshot/brick_memory.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate {
namespace {

// A tick takes 1 ms. If the servo needs this long, it does not run.
constexpr std::chrono::milliseconds kServoPatience{2000};

void CheckRevision(const std::optional<std::uint64_t>& expected, std::uint64_t current) {
  if (!expected || *expected == current) return;
  throw Error(
      ErrorKind::kConflict,
      fmt::format("the settings are at revision {}, not {}: read them again", current, *expected));
}

// For the servo, before there is a volume.
std::shared_ptr<const VolumeSnapshot> Empty() {
  VolumeMetadata metadata;
  metadata.size = Vec3i::Constant(2);
  const LeafPtr leaf = Leaf::Constant(LeafType::kFloat, 0.0f);
  return std::make_shared<VolumeSnapshot>(
      metadata, BrickDirectory(metadata.size, [&](const Vec3i&) { return leaf; }), 0, 0);
}

}  // namespace

Listening::Listening(Session& session, SceneListener& listener)
    : session_(session), listener_(listener) {
  const std::lock_guard lock(session_.mutex_);
  session_.listeners_.push_back(&listener_);
}

Listening::~Listening() {
  const std::lock_guard lock(session_.mutex_);
  std::erase(session_.listeners_, &listener_);
}

Session::Session(const DeviceDescription& device, SceneInbox& inbox, Pump& pump,
                 VolumeLoader loader)
    : device_(device), inbox_(inbox), pump_(pump), loader_(std::move(loader)), volume_(Empty()) {
  const std::lock_guard lock(mutex_);
  PublishLocked();
}

SettingsState Session::settings() const {
  const std::lock_guard lock(mutex_);
  return {.settings = settings_, .settings_revision = settings_revision_};
}

VolumeState Session::volume() const {
  const std::lock_guard lock(mutex_);
  return VolumeLocked();
}

FeltSession Session::Felt() const {
  const std::lock_guard lock(mutex_);
  LoadRequest request = request_;
  request.title = volume_->metadata().source;
  if (!request.source_stays) request.source.clear();
  RenderSettings settings = settings_;
  // The file has its own range and would refuse an isovalue outside it.
  settings.isovalue = std::clamp(settings.isovalue, loaded_range_.first, loaded_range_.second);
  return {std::move(request), settings, settings_revision_};
}

VolumeState Session::VolumeLocked() const {
  return {volume_,
          registration_,
          X_DI_,
          settings_revision_,
          scene_revision_,
          store_.unsaved_edits(),
          settings_.isovalue,
          values_,
          registration_store_ ? registration_store_->Failure(volume_->metadata(), voxels_name_)
                              : std::string(),
          keeper_ ? keeper_->failure() : std::string(),
          patient_axes_,
          /*replayed=*/false,
          {}};
}

bool Session::SetInitial(const RenderSettings& settings) {
  HapticSettings haptics = settings.haptics;
  CheckHaptics({}, haptics);
  CheckSide(haptics.layers, haptics.free_side);
  CheckHeld(haptics, device_);
  const std::lock_guard lock(mutex_);
  if (settings_revision_ > 0) return false;
  settings_.haptics = std::move(haptics);
  return true;
}

void Session::PublishLocked(std::span<const BrickChange> changes) {
  auto scene = std::make_unique<Scene>();
  scene->volume = volume_;
  scene->isovalue = settings_.isovalue;
  scene->settings = settings_.haptics;
  scene->settings_revision = settings_revision_;
  scene->scene_revision = ++scene_revision_;
  scene->patient_axes = patient_axes_;
  scene->forces_off = forces_off_ || !has_volume_;
  scene->series_position_frames = volume_->metadata().series_position_frames;
  ChooseTipLocked();
  FeelSurface(X_DI_, DensityOf(*volume_, settings_.isovalue), geometry_revision_, tip_, *scene);
  if (has_volume_) {
    for (SceneListener* listener : listeners_) listener->OnScene(*scene, changes);
  }
  inbox_.Publish(std::move(scene));
  ball_maker_.Wake();
}

AppliedTick Session::WaitForServo(std::uint64_t scene_revision) {
  const std::optional<AppliedTick> applied = pump_.WaitForScene(scene_revision, kServoPatience);
  if (!applied) throw Error(ErrorKind::kUnavailable, "the servo loop does not run");
  return *applied;
}

void Session::RequireServo() const {
  if (!pump_.ServoStands(kServoPatience)) return;
  throw Error(ErrorKind::kUnavailable, "the servo loop does not run: nothing was changed");
}

void Session::TakeBack(const RenderSettings& before, std::uint64_t revision) {
  const std::lock_guard lock(mutex_);
  if (settings_revision_ != revision) return;
  if (settings_.haptics.method != before.haptics.method) ++geometry_revision_;
  settings_ = before;
  ++settings_revision_;
  PublishLocked();
}

SettingsApplied Session::Update(const SettingsUpdate& update) {
  if (update.isovalue || update.normalized_isovalue || update.layers) first_load_.Require();
  RequireServo();
  CheckRoom(update);
  SettingsApplied result;
  RenderSettings before;
  std::uint64_t scene_revision = 0;
  {
    const std::lock_guard lock(mutex_);
    RequireNoReplay();
    CheckRevision(update.expected_revision, settings_revision_);
    const RenderSettings changed = Changed(*volume_, settings_, update);
    CheckSide(changed.haptics.layers, changed.haptics.free_side);
    if (update.layers) CheckLayers(changed.haptics.layers, volume_->metadata());
    CheckHeld(changed.haptics, device_);
    if (has_volume_ && update.NamesTip()) {
      const std::string refusal = RefusalOfTip(changed.haptics, X_DI_);
      if (!refusal.empty()) throw RangeError(update.tool ? "tool" : "tool_radius_mm", refusal);
      ball_maker_.ForgetProblem();
    }
    // Another decomposition makes another surface for the proxy.
    if (changed.haptics.method != settings_.haptics.method) ++geometry_revision_;
    before = std::exchange(settings_, changed);
    ++settings_revision_;
    PublishLocked();
    result.state = {.settings = settings_, .settings_revision = settings_revision_};
    scene_revision = scene_revision_;
  }
  try {
    result.applied = WaitForServo(scene_revision);
  } catch (const Error&) {
    TakeBack(before, result.state.settings_revision);
    throw;
  }
  return result;
}

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

VolumePlace Session::PlaceLoaded(const LoadRequest& request, VolumeMetadata& metadata) const {
  const std::optional<double>& scale = request.device_mm_per_volume_mm;
  std::optional<VolumePlace> stored;
  if (registration_store_) {
    stored = registration_store_->Find(metadata);
    const std::string lost = registration_store_->WhyLost(metadata);
    if (!lost.empty()) metadata.warnings.push_back(lost);
  }
  if (!stored) return FitToWorkspace(metadata, device_, scale);
  return Apply({.device_mm_per_volume_mm = scale}, metadata, device_, *stored);
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
  lock.unlock();
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

void Session::FitLayersLocked() {
  HapticSettings& felt = settings_.haptics;
  const std::string left = FitLayers(volume_->metadata(), felt.free_side, felt.layers);
  if (!left.empty()) LogWarning("{}", left);
}

VolumeState Session::Move(const std::function<VolumePlace(const VolumeState&)>& change,
                          const std::optional<std::uint64_t>& expected_revision,
                          const std::optional<PatientFacing>& facing) {
  const std::lock_guard lock(mutex_);
  RequireNoReplay();
  CheckRevision(expected_revision, settings_revision_);
  const VolumeMetadata& metadata = volume_->metadata();
  if (facing &&
      facing->loaded_revision.value_or(volume_->loaded_revision()) != volume_->loaded_revision()) {
    throw Error(ErrorKind::kConflict,
                "another volume has been loaded: look at it, and say where it faces");
  }
  if (facing && !metadata.patient_axes.empty()) {
    throw Error(ErrorKind::kFailedPrecondition,
                "the file states its orientation: where the patient faces cannot be answered");
  }
  std::string axes = facing ? PatientAxesOf(*facing) : patient_axes_;
  registration_ = change(VolumeLocked());
  const AffineMap before = std::exchange(X_DI_, registration_.X_DW * metadata.WorldFromIndex());
  // An answer alone is not felt, and leaves a fitted place to be fitted anew.
  const bool moves = !facing || X_DI_ != before;
  // After a reshape, the registration is not stored: it would replace the registration of the
  // file's lattice.
  if (registration_store_ && moves && !is_reshaped_) {
    registration_store_->Keep(metadata, registration_);
  }
  if (registration_store_ && facing) registration_store_->KeepAxes(voxels_name_, axes);
  patient_axes_ = std::move(axes);
  if (moves) ++geometry_revision_;
  ++settings_revision_;
  PublishLocked();
  VolumeState state = VolumeLocked();
  if (moves && is_reshaped_) {
    state.move_problem =
        "the volume has another lattice than its file: save it, and load that file";
  }
  return state;
}

void Session::RaiseSettingsRevision(std::uint64_t above) {
  const std::lock_guard lock(mutex_);
  settings_revision_ = std::max(settings_revision_, above) + 1;
  PublishLocked();
}

void Session::RequireNoReplay() const {
  if (!forces_off_) return;
  throw Error(ErrorKind::kConflict,
              "a recording is replayed: nothing can be changed until the replay has ended");
}

void Session::SetForcesOff(bool off) {
  const std::lock_guard lock(mutex_);
  forces_off_ = off;
  PublishLocked();
}

}  // namespace palpate
