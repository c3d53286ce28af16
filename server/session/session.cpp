#include "server/session/session.h"

#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <utility>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"
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

}  // namespace palpate
