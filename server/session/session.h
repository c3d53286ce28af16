// Owns everything that is felt: the volume, its registration, the isovalue and the settings.
// Validates every change, publishes the change to the servo as one scene, and reports the tick that
// used the change first.
//
// Revisions:
//   scene     rises with every scene that is published
//   settings  rises with changes of settings and registration, and with loaded volumes
//   volume    rises with loaded volumes and with every change of voxels
//
// Isovalues: in data units, or normalised over the range of the volume at load.
// Threads: any ordinary thread; never the servo's. Changes are serialised.
// Errors: Error; then nothing changes.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/felt/registration.h"
#include "server/felt/scene.h"
#include "server/kept/registration_store.h"
#include "server/kept/session_keeper.h"
#include "server/live_volume/volume_loader.h"
#include "server/live_volume/volume_store.h"
#include "server/pump/pump.h"
#include "server/session/ball_maker.h"
#include "server/session/first_load.h"
#include "server/session/settings_update.h"
#include "server/session/shown.h"
#include "server/volume/load/suggested_isovalues.h"

namespace palpate {

struct SettingsState {
  RenderSettings settings;
  std::uint64_t settings_revision = 0;
  bool replayed = false;  // of a recording that is replayed (shown.h)
};

// Called for every scene before the servo can see it, in order.
class SceneListener {
 public:
  SceneListener() = default;
  virtual ~SceneListener() = default;
  SceneListener(const SceneListener&) = delete;
  SceneListener& operator=(const SceneListener&) = delete;
  // `changes`: the bricks in which the scene's volume differs from the last scene's. Empty for
  // another volume (its revision then equals its loaded revision). Called on the thread that
  // publishes. Must not block or call the session.
  virtual void OnScene(const Scene& scene, std::span<const BrickChange> changes) = 0;
};

class Session;

// Registers a listener with a session during the lifetime of this object. Construct it before the
// first Load. Make it the last member of its listener, so that it is destroyed first.
class Listening {
 public:
  // Borrows both.
  Listening(Session& session, SceneListener& listener);
  // After its return, the listener is not called any more.
  ~Listening();
  Listening(const Listening&) = delete;
  Listening& operator=(const Listening&) = delete;

 private:
  Session& session_;
  SceneListener& listener_;
};

struct SettingsApplied {
  SettingsState state;
  AppliedTick applied;
};

struct VolumeState {
  std::shared_ptr<const VolumeSnapshot> volume;
  VolumePlace registration;
  AffineMap X_DI;
  std::uint64_t settings_revision = 0;
  std::uint64_t scene_revision = 0;  // for WaitForServo
  std::uint64_t unsaved_edits = 0;
  double isovalue = 0.0;                       // data units
  std::shared_ptr<const VolumeValues> values;  // as loaded; edits do not change them
  // Why a changed place or a new answer is not kept for the next load, and why the settings are
  // not kept for palpated's next start; empty: they are.
  std::string place_problem, settings_problem;
  std::string patient_axes;    // of the file or answered, as in VolumeMetadata; empty: unknown
  bool replayed = false;       // as in SettingsState
  std::string move_problem{};  // of a Move: why no store gets the place; empty: one may

  bool patient_axes_answered() const {
    return !patient_axes.empty() && volume->metadata().patient_axes.empty();
  }
};

class Session {
  friend class Listening;

 public:
  // Borrows all arguments except the loader's options.
  Session(const DeviceDescription& device, SceneInbox& inbox, Pump& pump, VolumeLoader loader);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Sets the store of earlier registrations. Volumes are placed there again when loaded. Call it
  // before the first Load; borrowed.
  void SetRegistrationStore(RegistrationStore& store) { registration_store_ = &store; }
  // Sets what saves the settings for the next start. Call it before the first Update; borrowed.
  void SetKeeper(SessionKeeper& keeper) { keeper_ = &keeper; }

  // Called before another volume is felt, with the surface that is about to come. May wait for a
  // second: nothing is locked but other loads. Set it before the first Load; it must stay valid
  // until no volume is loaded any more.
  using BeforeOtherVolume = std::function<void(const HapticSurface& surface)>;
  void SetBeforeOtherVolume(BeforeOtherVolume call) { before_other_volume_ = std::move(call); }

  // Until the first volume is felt, the servo gets scenes of an empty volume, without forces.
  // Listeners do not get these scenes, and only settings(), SetInitial, Load and an Update without
  // an isovalue may be called.
  FirstLoad& first_load() { return first_load_; }

  SettingsState settings() const;
  VolumeState volume() const;
  FeltSession Felt() const;
  // What is felt of the settings' ball or tool.
  BallState ball() const;

  // Waits until the servo has used the change. Throws kInvalidArgument, kConflict (the revision, or
  // a replay), kUnavailable,
  // kTooLarge if there is no room for the ball or tool, kFailedPrecondition for a tool that the
  // device or other settings forbid, and kLoading for an isovalue before the first
  // volume. If the servo stops before it uses the change, the change is taken back, unless somebody
  // else has changed settings since.
  SettingsApplied Update(const SettingsUpdate& update);

  // Wait, for about a second at most, until the settings, or the place and the answer, are on the
  // disk. Return why they are not; empty: they are, or nothing is kept.
  std::string AwaitSettingsKept() { return keeper_ ? keeper_->Await() : std::string(); }
  std::string AwaitPlaceKept() {
    return registration_store_ ? registration_store_->Await() : std::string();
  }

  // Sets the settings to start with, except for the isovalue. Call it before the first Load. Does
  // nothing, and returns false, if somebody has changed settings. Throws kInvalidArgument.
  bool SetInitial(const RenderSettings& settings);

  // Loads and publishes without waiting for the servo. `settings`: felt from the same tick on as
  // the volume; an isovalue is the new volume's. Throws kConflict while another load runs, and
  // kFailedPrecondition if edits are not saved, unless the request discards them.
  VolumeState Load(const LoadRequest& request, const LoadProgress& progress,
                   const LoadCancelled& cancelled, const SettingsUpdate& settings = {});
  // Throws kInvalidArgument if no volume can be loaded with these settings, or if the request has
  // an isovalue, too. To be told early: Load and PublishVolume check the same.
  void CheckSettings(const LoadRequest& request, const SettingsUpdate& settings) const;

  // Blocks other loads as long as the caller holds the lock; for callers that load without Load().
  // Throws kConflict while another load runs.
  std::unique_lock<std::mutex> BeginLoad();
  // Publishes another volume. It lies where it was felt last, or is fitted to the workspace. The
  // request's scale, if given, replaces the scale. Without an isovalue in the request, the first
  // suggestion of ValuesOf is taken. `frames_bytes`: the memory of all frames if the
  // volume is one of several frames; used in messages. `settings`: see Load. Layers and a ball that
  // the volume cannot have are left out, which a warning of its metadata says. `progress`: of the
  // ball's field; what it throws ends the publication.
  VolumeState PublishVolume(
      const LoadRequest& request, VolumeMetadata metadata, const BrickDirectory& bricks,
      std::uint64_t frames_bytes = 0, const SettingsUpdate& settings = {},
      const LoadProgress& progress = [](std::string_view, double) {});

  // Change voxels by its Edit.
  VolumeStore& store() { return store_; }

  // Moves the volume. `change` computes the new registration from the present state, under the
  // session's lock. Throws kInvalidArgument; kConflict if the settings revision is not the expected
  // one, and during a replay. The registration is stored for the next load of the volume, unless
  // the volume was reshaped. `facing`: an answer to where the patient faces, which is stored for
  // these voxels. Throws kFailedPrecondition if the file states its orientation.
  VolumeState Move(const std::function<VolumePlace(const VolumeState&)>& change,
                   const std::optional<std::uint64_t>& expected_revision = {},
                   const std::optional<PatientFacing>& facing = {});

  // What viewers are shown: this session or a replay.
  Shown& shown() { return shown_; }
  const Shown& shown() const { return shown_; }
  // Publishes the settings with a revision above this one, which viewers were shown in a replay.
  void RaiseSettingsRevision(std::uint64_t above);
  // A replay is shown. No force is felt while this is on, and Update, Move and edits throw
  // kConflict.
  void SetForcesOff(bool off);
  // Throws kConflict while forces are off.
  void RequireNoReplay() const;
  // Takes no lock.
  bool forces_off() const { return forces_off_; }

  // Returns the tick at which the servo first used a scene. Throws kUnavailable.
  AppliedTick WaitForServo(std::uint64_t scene_revision);

  // Add volumes and other owners of many bricks here when nobody shows them any more.
  RetiredVolumes& retired() { return store_.retired(); }

  const DeviceDescription& device() const { return device_; }
  const VolumeLoader& loader() const { return loader_; }

 private:
  HapticSettings FeltOn(const LoadRequest& request, const SettingsUpdate& settings,
                        const AffineMap& X_DI, VolumeMetadata& metadata) const;
  std::vector<FeltBall> FieldsFor(const HapticSettings& felt, const SettingsUpdate& settings,
                                  const AffineMap& X_DI, const VolumeSnapshot& volume,
                                  const LoadProgress& progress) const;
  // Throws kConflict if the settings have another revision.
  void RequireRevision(const std::optional<std::uint64_t>& expected) const;
  // Throws kUnavailable if the servo does not run, because then nobody would feel a change.
  void RequireServo() const;
  void TellBeforeOtherVolume(const HapticSettings& felt, const AffineMap& X_DI, double isovalue,
                             const std::vector<FeltBall>& fields,
                             std::shared_ptr<const VolumeSnapshot> volume) const;
  VolumePlace PlaceLoaded(const LoadRequest& request, VolumeMetadata& metadata) const;
  FreeSide SideOf(const VolumeMetadata& metadata, const LoadRequest& request,
                  const SettingsUpdate& settings) const;
  void TakeBack(const RenderSettings& before, std::uint64_t revision);
  void TakeLoaded(const LoadRequest& request, const SettingsUpdate& settings,
                  const VolumePlace& registration,
                  const std::shared_ptr<const VolumeSnapshot>& volume, double isovalue);
  void TakeLattice();
  void FitLayersLocked();
  std::string RemoveLayersLocked(const SettingsUpdate& settings, const VolumeMetadata& metadata,
                                 SurfaceLayers& layers) const;
  bool Follow(std::vector<FeltBall>& fields, const VolumeSnapshot& volume) const;
  std::uint64_t PublishEdited(const std::shared_ptr<const VolumeSnapshot>& volume,
                              std::span<const BrickChange> changes);
  void PublishLocked(std::span<const BrickChange> changes = {});
  // Throws Error (kTooLarge) if there is no room for the tip that the update asks for.
  void CheckRoom(const SettingsUpdate& update) const;
  // The fields that the tip of these settings lacks; the first that the present tip does.
  std::vector<Ball> MissingFields(const HapticSettings& haptics) const;
  std::optional<BallMaker::Wanted> MissingField() const;
  void TellFieldBytes();
  bool MayStay(const FeltTip& tip) const;
  // Returns false if it is not wanted any more.
  bool TakeField(FeltBall made);
  void ChooseTipLocked();
  void SetTipLocked(FeltTip tip);
  VolumeState VolumeLocked() const;
  LoadedVolume LoadBricks(const LoadRequest& request, const LoadProgress& progress,
                          const LoadCancelled& cancelled, MemoryClaim& claim,
                          std::vector<std::string>& warnings);

  const DeviceDescription& device_;
  SceneInbox& inbox_;
  Pump& pump_;
  VolumeLoader loader_;
  RegistrationStore* registration_store_ = nullptr;
  SessionKeeper* keeper_ = nullptr;
  BeforeOtherVolume before_other_volume_;
  FirstLoad first_load_;
  Shown shown_{*this};

  // Lock order: load_mutex_, the store's mutex, mutex_.
  std::mutex load_mutex_;
  mutable std::mutex mutex_;  // guards the members below
  std::vector<SceneListener*> listeners_;
  std::shared_ptr<const VolumeSnapshot> volume_;  // the newest scene's volume
  std::shared_ptr<const VolumeValues> values_;    // of the volume as loaded
  LoadRequest request_;                           // the request that loaded volume_
  bool is_reshaped_ = false;                      // the lattice has changed since the load
  Vec3i loaded_size_ = Vec3i::Zero();             // its lattice at the load
  AffineMap loaded_X_WI_{};
  std::pair<double, double> loaded_range_{};  // range of values at the load
  // The chosen isovalue, and its value after clamping to the range of another lattice.
  std::optional<std::pair<double, double>> held_isovalue_{};
  VolumePlace registration_;
  AffineMap X_DI_;
  FeltTip tip_;                 // that is felt
  std::vector<FeltBall> made_;  // fields of the settings' tip, of which others are missing yet
  std::string patient_axes_;    // of the file or answered; empty: unknown
  std::string voxels_name_;     // of the voxels as loaded, for answers
  RenderSettings settings_;
  FreeSide side_of_densities_ = FreeSide::kBelow;  // the free side to restore after a level set
  std::atomic<bool> forces_off_{false};            // written under the lock
  bool has_volume_ = false;                        // volume_ is not the empty one of the start
  std::uint64_t settings_revision_ = 0;
  std::uint64_t geometry_revision_ = 0;
  std::uint64_t scene_revision_ = 0;

  // Last, so that their threads end before the other members.
  VolumeStore store_{
      loader_.budget, [this] { inbox_.Collect(); },
      [this](const std::shared_ptr<const VolumeSnapshot>& volume,
             std::span<const BrickChange> changes) { return PublishEdited(volume, changes); }};
  BallMaker ball_maker_{loader_.budget,
                        [this] {
                          const std::lock_guard lock(mutex_);
                          return MissingField();
                        },
                        [this](FeltBall made) { return TakeField(std::move(made)); }};
};

}  // namespace palpate
