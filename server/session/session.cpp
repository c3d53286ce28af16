#include "server/session/session.h"

#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"
#include "server/session/setting_checks.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate {
namespace {

// A tick takes 1 ms. If the servo needs this long, it does not run.
constexpr std::chrono::milliseconds kServoPatience{2000};

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

// Where a session's volume lies, and where the patient faces.

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

VolumeState Session::Move(const std::function<VolumePlace(const VolumeState&)>& change,
                          const std::optional<std::uint64_t>& expected_revision,
                          const std::optional<PatientFacing>& facing) {
  const std::lock_guard lock(mutex_);
  RequireNoReplay();
  RequireRevision(expected_revision);
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

// A session's settings: from the start, changed, and taken back.

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

void Session::RequireRevision(const std::optional<std::uint64_t>& expected) const {
  if (!expected || *expected == settings_revision_) return;
  throw Error(ErrorKind::kConflict,
              fmt::format("the settings are at revision {}, not {}: read them again",
                          settings_revision_, *expected));
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
    RequireRevision(update.expected_revision);
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

}  // namespace palpate
