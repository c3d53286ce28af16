// Owns what is felt: the volume, its registration, the isovalue and settings.
// Validates every change, publishes it to the servo as one scene, and says at
// which tick it was first used.
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
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/servo/scene.h"
#include "server/session/pump.h"
#include "server/session/registration.h"
#include "server/session/volume_loader.h"

namespace palpate {

struct RenderSettings {
  double isovalue = 0.0;             // data units
  double normalized_isovalue = 0.5;  // the same
  HapticSettings haptics{};
  DecompositionMethod method = DecompositionMethod::kTpbcc;
};

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

struct SettingsApplied {
  SettingsState state;
  AppliedTick applied;
};

struct VolumeState {
  std::shared_ptr<const VolumeSnapshot> volume;
  Registration registration;
  AffineMap X_DI;
  std::uint64_t settings_revision = 0;
};

struct LoadRequest {
  std::string source;
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  std::optional<Vec3> spacing_mm{};
  std::optional<double> device_mm_per_volume_mm{};
};

class Session {
 public:
  // Borrows all but the loader's options.
  Session(const DeviceSpec& device, SceneInbox& inbox, Pump& pump, VolumeLoader loader)
      : device_(device), inbox_(inbox), pump_(pump), loader_(std::move(loader)) {}

  // Once a Load has succeeded.
  SettingsState settings() const;
  VolumeState volume() const;

  // Waits until the servo has used the change. kInvalidArgument, kConflict,
  // kUnavailable.
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

 private:
  std::uint64_t PublishLocked();
  AppliedTick WaitForServo(std::uint64_t settings_revision);

  const DeviceSpec& device_;
  SceneInbox& inbox_;
  Pump& pump_;
  VolumeLoader loader_;
  std::mutex load_mutex_;

  mutable std::mutex mutex_;  // guards what follows
  std::shared_ptr<const VolumeSnapshot> volume_;
  Registration registration_;
  AffineMap X_DI_;
  RenderSettings settings_;
  std::uint64_t settings_revision_ = 0;
  std::uint64_t volume_revision_ = 0;
  std::uint64_t geometry_revision_ = 0;
};

}  // namespace palpate
