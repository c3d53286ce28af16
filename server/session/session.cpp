#include "server/session/session.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <limits>
#include <utility>

#include "common/error/error.h"
#include "server/volume/snapshot_builder.h"

namespace palpate {
namespace {

// A tick takes 1 ms; a servo that needs this long does not run.
constexpr std::chrono::milliseconds kServoPatience{2000};

// `unit` with a leading blank, or empty. NaN is in no range.
void CheckRange(std::string_view name, double value, double low, double high,
                std::string_view unit) {
  if (value >= low && value <= high) return;
  throw Error(ErrorKind::kInvalidArgument,
              fmt::format("{} {} is not within {:g} to {:g}{}", name, value, low, high, unit));
}

// The normalised density that stands for an isovalue in data units: the largest
// whose data value is not above it, so that no density at or below it reads back
// above the isovalue.
double DensityOf(const VolumeSnapshot& volume, double isovalue) {
  double density = volume.Normalize(isovalue);
  while (volume.Denormalize(density) > isovalue) {
    density = std::nextafter(density, -std::numeric_limits<double>::infinity());
  }
  return density;
}

// Takes the isovalue in whichever form it is given; `current` is normalised.
double ChosenIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized, double current) {
  if (isovalue && normalized) {
    throw Error(ErrorKind::kInvalidArgument,
                "give the isovalue in data units or normalised, not both");
  }
  const VolumeMetadata& metadata = volume.metadata();
  if (isovalue) {
    CheckRange("isovalue", *isovalue, metadata.value_min, metadata.value_max,
               metadata.unit.empty() ? "" : " " + metadata.unit);
    return *isovalue;
  }
  const double share = normalized.value_or(current);
  CheckRange("normalized isovalue", share, 0.0, 1.0, "");
  return volume.Denormalize(share);
}

void CheckHaptics(const HapticSettings& haptics) {
  for (const NumberSetting& setting : kNumberSettings) {
    CheckRange(setting.key, haptics.*setting.member, setting.low, setting.high, setting.unit);
  }
}

// Only some methods promise that the proxy never falls through; a hand is not to
// find out about the others.
void CheckMethod(DecompositionMethod method, const DeviceSpec& device) {
  if (IsSafe(method) || device.verification_level == VerificationLevel::kSimulated) return;
  throw Error(ErrorKind::kInvalidArgument,
              std::string(MethodName(method)) +
                  " is for comparison on the simulated device: with real hardware use tpbcc or "
                  "bcc");
}

RenderSettings Changed(const VolumeSnapshot& volume, RenderSettings settings,
                       const SettingsUpdate& update) {
  if (update.isovalue || update.normalized_isovalue) {
    settings.isovalue = ChosenIsovalue(volume, update.isovalue, update.normalized_isovalue, 0.0);
    settings.normalized_isovalue = volume.Normalize(settings.isovalue);
  }
  HapticSettings& haptics = settings.haptics;
  for (const auto& [member, value] : update.numbers) haptics.*member = value;
  for (const auto& [member, value] : update.flags) haptics.*member = value;
  haptics.free_side = update.free_side.value_or(haptics.free_side);
  CheckHaptics(haptics);
  if (update.method) settings.method = *update.method;
  return settings;
}

}  // namespace

SettingsState Session::settings() const {
  const std::lock_guard lock(mutex_);
  return {settings_, settings_revision_};
}

VolumeState Session::volume() const {
  const std::lock_guard lock(mutex_);
  return {volume_, registration_, X_DI_, settings_revision_};
}

void Session::SetInitial(const RenderSettings& settings) {
  CheckHaptics(settings.haptics);
  CheckMethod(settings.method, device_);
  const std::lock_guard lock(mutex_);
  settings_.haptics = settings.haptics;
  settings_.method = settings.method;
}

std::uint64_t Session::PublishLocked() {
  auto scene = std::make_unique<Scene>();
  scene->volume = volume_;
  scene->isovalue = settings_.isovalue;
  scene->settings = settings_.haptics;
  scene->settings_revision = ++settings_revision_;
  scene->surface =
      MakeHapticSurface(*volume_, X_DI_, DensityOf(*volume_, settings_.isovalue), settings_.method,
                        geometry_revision_, settings_.haptics.free_side);
  inbox_.Publish(std::move(scene));
  return settings_revision_;
}

AppliedTick Session::WaitForServo(std::uint64_t settings_revision) {
  const std::optional<AppliedTick> applied =
      pump_.WaitForRevision(settings_revision, kServoPatience);
  if (!applied) throw Error(ErrorKind::kUnavailable, "the servo loop does not run");
  return *applied;
}

SettingsApplied Session::Update(const SettingsUpdate& update) {
  SettingsApplied result;
  {
    const std::lock_guard lock(mutex_);
    if (update.expected_revision && *update.expected_revision != settings_revision_) {
      throw Error(ErrorKind::kConflict,
                  fmt::format("the settings are at revision {}, not {}: read them again",
                              settings_revision_, *update.expected_revision));
    }
    const RenderSettings changed = Changed(*volume_, settings_, update);
    CheckMethod(changed.method, device_);
    // Another decomposition is another surface to the proxy.
    if (changed.method != settings_.method) ++geometry_revision_;
    settings_ = changed;
    PublishLocked();
    result.state = {settings_, settings_revision_};
  }
  result.applied = WaitForServo(result.state.settings_revision);
  return result;
}

VolumeState Session::Load(const LoadRequest& request, const LoadProgress& progress,
                          const LoadCancelled& cancelled) {
  const std::unique_lock loading(load_mutex_, std::try_to_lock);
  if (!loading) {
    throw Error(ErrorKind::kConflict, "another volume is being loaded: try again when it is done");
  }
  std::vector<std::string> warnings;
  const VolumeFile file =
      loader_.Load(request.source, request.spacing_mm, progress, cancelled, warnings);
  for (const std::string& warning : warnings) spdlog::warn("{}", warning);
  VolumeMetadata metadata = file.metadata;
  metadata.source = request.source;
  const Registration registration =
      FitToWorkspace(metadata, device_, request.device_mm_per_volume_mm);
  progress("publishing", 1.0);
  // Only loads change the volume's revision, and there is one at a time.
  const auto volume = MakeSnapshot(file.grid, metadata, volume_revision_ + 1);
  if (cancelled()) throw Error(ErrorKind::kCancelled, "loading was cancelled");

  const std::lock_guard lock(mutex_);
  const double isovalue = ChosenIsovalue(*volume, request.isovalue, request.normalized_isovalue,
                                         settings_.normalized_isovalue);
  volume_ = volume;
  ++volume_revision_;
  ++geometry_revision_;
  registration_ = registration;
  X_DI_ = registration.X_DW * metadata.WorldFromIndex();
  settings_.isovalue = isovalue;
  settings_.normalized_isovalue = volume_->Normalize(isovalue);
  PublishLocked();
  return {volume_, registration_, X_DI_, settings_revision_};
}

VolumeState Session::LoadAndWait(const LoadRequest& request, const LoadProgress& progress,
                                 const LoadCancelled& cancelled, AppliedTick& applied) {
  const VolumeState state = Load(request, progress, cancelled);
  applied = WaitForServo(state.settings_revision);
  inbox_.Collect();  // the volume felt so far
  return state;
}

}  // namespace palpate
