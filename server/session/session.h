// Owns what is felt: the volume, its registration, the isovalue and settings.
// Validates every change, publishes it to the servo as one scene, and says at
// which tick it was first used.
//
// Revisions: of the scene, with all that is published; of the settings, with
// settings, registration and volumes that are loaded; of the volume, with volumes
// that are loaded and whatever changes voxels.
//
// Isovalues: in data units, or normalised over the range of the volume at load.
// Threads: any ordinary thread; never the servo's. Changes are serialised.
// Errors: Error; nothing changes then, and what was felt stays.
#pragma once

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
#include "server/samples/pump.h"
#include "server/scene/registration.h"
#include "server/scene/render_settings.h"
#include "server/scene/scene.h"
#include "server/state/registration_store.h"
#include "server/state/session_file.h"
#include "server/store/volume_loader.h"
#include "server/store/volume_store.h"

namespace palpate {

// What to change; isovalue in one of its two forms.
struct SettingsUpdate {
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  // Members of RenderSettings::haptics and their new values.
  std::vector<std::pair<double HapticSettings::*, double>> numbers{};
  std::vector<std::pair<bool HapticSettings::*, bool>> flags{};
  std::optional<FreeSide> free_side{};
  std::optional<DecompositionMethod> method{};
  std::optional<std::uint64_t> expected_revision{};
};

struct SettingsState {
  RenderSettings settings;
  std::uint64_t settings_revision = 0;
};

// Told of every scene before the servo can see it, in order.
class SceneListener {
 public:
  SceneListener() = default;
  virtual ~SceneListener() = default;
  SceneListener(const SceneListener&) = delete;
  SceneListener& operator=(const SceneListener&) = delete;
  // Of a scene with the volume of the one before it but for these bricks; none for
  // another volume (its revision is its loaded_revision then). On the thread that
  // publishes; must not block, nor call the session.
  virtual void OnScene(const Scene& scene, std::span<const BrickChange> changes) = 0;
};

class Session;

// Has a session tell a listener, for as long as it lives. Before the first Load. The last member
// of its listener, so that it goes first.
class Listening {
 public:
  // Borrows both.
  Listening(Session& session, SceneListener& listener);
  // When it returns, the listener is not called any more.
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
  Registration registration;
  AffineMap X_DI;
  std::uint64_t settings_revision = 0;
  std::uint64_t scene_revision = 0;  // for WaitForServo
};

class Session {
  friend class Listening;

 public:
  // Borrows all but the loader's options.
  Session(const DeviceSpec& device, SceneInbox& inbox, Pump& pump, VolumeLoader loader);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Where volumes lay before and will lie again; before the first Load, borrowed.
  void SetRegistrationStore(RegistrationStore& store) { registration_store_ = &store; }

  // Once a Load has succeeded.
  SettingsState settings() const;
  VolumeState volume() const;
  FeltSession Felt() const;

  // Waits until the servo has used the change. kInvalidArgument, kConflict,
  // kUnavailable: what a servo that has just stopped did not use is taken back, unless
  // somebody else has changed settings since.
  SettingsApplied Update(const SettingsUpdate& update);

  // Settings to start with, but for the isovalue; before the first Load.
  // kInvalidArgument.
  void SetInitial(const RenderSettings& settings);

  // Loads and publishes without waiting for the servo: at start-up, before it
  // runs.
  VolumeState Load(const LoadRequest& request, const LoadProgress& progress,
                   const LoadCancelled& cancelled);
  // The same for a running servo; `applied` is the first tick with the volume.
  // kConflict while another load runs.
  VolumeState LoadAndWait(const LoadRequest& request, const LoadProgress& progress,
                          const LoadCancelled& cancelled, AppliedTick& applied);

  // For those who load by other ways: held for as long as it takes. kConflict while
  // another load runs.
  std::unique_lock<std::mutex> BeginLoad();
  // Publishes another volume: where it lay when it was felt last, or fitted, with
  // the request's scale if that names one. `frames_bytes`: of all frames, where it is one of
  // several that are in memory; for messages.
  VolumeState PublishVolume(const LoadRequest& request, const VolumeMetadata& metadata,
                            const BrickDirectory& bricks, std::uint64_t frames_bytes = 0);

  // Voxels are changed there, by Edit.
  VolumeStore& store() { return store_; }

  // Where the volume lies. `change` makes the new one of the present one, under the
  // session's lock. kInvalidArgument; kConflict for another settings revision than
  // expected. `keep`: for when the volume is loaded again.
  VolumeState Move(const std::function<Registration(const VolumeState&)>& change,
                   const std::optional<std::uint64_t>& expected_revision = {}, bool keep = true);

  // Nothing is felt while on.
  void SetForcesOff(bool off);

  // The tick at which the servo first used a scene. kUnavailable.
  AppliedTick WaitForServo(std::uint64_t scene_revision);

  // For volumes, and what else holds many bricks, that nobody shows any more.
  RetiredVolumes& retired() { return store_.retired(); }

  const DeviceSpec& device() const { return device_; }
  const VolumeLoader& loader() const { return loader_; }

 private:
  // kUnavailable where the servo stands, so that nobody would feel a change.
  void RequireServo() const;
  Registration PlaceLoaded(const LoadRequest& request, const VolumeMetadata& metadata) const;
  double StartingDensity(const VolumeSnapshot& volume) const;
  void TakeSideOf(const VolumeMetadata& metadata, const std::optional<FreeSide>& wanted);
  void TakeBack(const RenderSettings& before, std::uint64_t revision);
  void TakeLoaded(const LoadRequest& request, const Registration& registration,
                  const std::shared_ptr<const VolumeSnapshot>& volume);
  void TakeLattice();
  std::uint64_t PublishEdited(const std::shared_ptr<const VolumeSnapshot>& volume,
                              std::span<const BrickChange> changes);
  void PublishLocked(std::span<const BrickChange> changes = {});
  VolumeState VolumeLocked() const;
  LoadedVolume LoadBricks(const LoadRequest& request, const LoadProgress& progress,
                          const LoadCancelled& cancelled, MemoryClaim& claim,
                          std::vector<std::string>& warnings);

  const DeviceSpec& device_;
  SceneInbox& inbox_;
  Pump& pump_;
  VolumeLoader loader_;
  RegistrationStore* registration_store_ = nullptr;

  // In the order in which they are taken; the store's comes between the two.
  std::mutex load_mutex_;
  mutable std::mutex mutex_;  // guards what follows
  std::vector<SceneListener*> listeners_;
  std::shared_ptr<const VolumeSnapshot> volume_;  // of the newest scene
  LoadRequest request_;                           // which volume_ came of
  bool is_reshaped_ = false;                      // since then
  std::pair<double, double> loaded_range_{};      // of values, then
  // The isovalue that was chosen, and what it became in the range of another lattice.
  std::optional<std::pair<double, double>> held_isovalue_{};
  Registration registration_;
  AffineMap X_DI_;
  RenderSettings settings_;
  FreeSide side_of_densities_ = FreeSide::kBelow;  // while a level set is felt
  bool forces_off_ = false;
  std::uint64_t settings_revision_ = 0;
  std::uint64_t geometry_revision_ = 0;
  std::uint64_t scene_revision_ = 0;

  // Its thread ends first.
  VolumeStore store_{
      loader_.budget, [this] { inbox_.Collect(); },
      [this](const std::shared_ptr<const VolumeSnapshot>& volume,
             std::span<const BrickChange> changes) { return PublishEdited(volume, changes); }};
};

}  // namespace palpate
