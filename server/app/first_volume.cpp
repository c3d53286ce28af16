#include "server/app/first_volume.h"

#include <filesystem>

#include "server/log/log.h"
#include "server/session/range.h"

namespace palpate {
namespace {

std::string Name(const std::string& volume) {
  return volume.starts_with("builtin:") ? volume : std::filesystem::absolute(volume).string();
}

// Follows links: the administrator's configuration may name any file.
std::string Source(const std::string& volume) {
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(volume, error);
  return volume.starts_with("builtin:") || error ? Name(volume) : real.string();
}

void Load(const LoadRequest& request, Session& session, const LoadCancelled& cancelled) {
  LogInfo("loading {}", request.source);
  const auto quiet = [](std::string_view, double) {};
  const VolumeState state = session.Load(request, quiet, cancelled);
  const VolumeMetadata& m = state.volume->metadata();
  LogInfo("volume {}x{}x{} {}, spacing {:g} x {:g} x {:g} mm, values {:g} to {:g} {}", m.size.x(),
          m.size.y(), m.size.z(), m.original_type, m.spacing_mm.x(), m.spacing_mm.y(),
          m.spacing_mm.z(), m.value_min, m.value_max, m.unit);
  const RenderSettings settings = session.settings().settings;
  LogInfo("scale {:.4g} device mm per volume mm; isovalue {:g} (normalized {:.4g})",
          state.registration.device_mm_per_volume_mm, settings.isovalue,
          settings.normalized_isovalue);
}

// Loads the configured volume. An error names the configuration's line.
void LoadConfigured(const LoadedConfig& loaded, Session& session, const LoadCancelled& cancelled) {
  try {
    Load(ConfiguredVolume(loaded.config), session, cancelled);
  } catch (const RangeError& error) {
    throw AtKey(loaded, "volume.isovalue", error);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kCancelled) throw;
    throw AtKey(loaded, "volume.source", error);
  }
}

// The paths of a client's volume are checked against `paths`. The configured volume's are not.
LoadRequest VolumeLeft(const FeltSession& left, const LoadRequest& configured,
                       const PathPolicy& paths) {
  LoadRequest request = left.volume;
  request.free_side = left.settings.haptics.free_side;
  if (request.source != configured.source) request.source = paths.CheckLoad(request.source);
  return request;
}

// The left session's free side may have been that of a level set that is not restored.
void LeaveSide(const FeltSession& left, const RenderSettings& configured, Session& session) {
  RenderSettings settings = left.settings;
  settings.haptics.free_side = configured.haptics.free_side;
  try {
    session.SetInitial(settings);
  } catch (const Error&) {
    // The value is out of range, which was logged before. The configured value stays.
  }
}

// Returns false if the session's volume is not restored.
bool BringBack(const FeltSession& left, const LoadRequest& configured,
               const RenderSettings& configured_settings, Session& session, const PathPolicy& paths,
               const LoadCancelled& cancelled) {
  const std::string& name = left.volume.title;
  try {
    session.SetInitial(left.settings);
    if (left.volume.source.empty()) {
      LogWarning(
          "settings come back; {} does not: uploads and series are loaded again by "
          "clients",
          name);
      LeaveSide(left, configured_settings, session);
      return false;
    }
    Load(VolumeLeft(left, configured, paths), session, cancelled);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kCancelled) throw;
    LogWarning("{} does not come back, its settings do: {}", name, error.what());
    LeaveSide(left, configured_settings, session);
    return false;
  }
  LogWarning("the previous palpated did not end cleanly: {} and the settings are back{}", name,
             left.is_edited ? "; edits that were not saved are lost" : "");
  return true;
}

}  // namespace

LoadRequest ConfiguredVolume(const Config& config) {
  return {.source = Source(config.volume),
          .title = Name(config.volume),
          .isovalue = config.isovalue,
          .normalized_isovalue = config.normalized_isovalue,
          .spacing_mm = config.spacing_mm,
          .device_mm_per_volume_mm = config.device_mm_per_volume_mm,
          .grid = config.grid,
          .component = config.component};
}

RenderSettings ConfiguredSettings(const Config& config) {
  return {.haptics = config.haptics, .method = config.method};
}

void LoadFirstVolume(const LoadedConfig& loaded, Session& session, SessionKeeper& keeper,
                     const PathPolicy& paths, const LoadCancelled& cancelled) {
  const LoadRequest configured = ConfiguredVolume(loaded.config);
  session.SetInitial(ConfiguredSettings(loaded.config));
  const std::optional<FeltSession> left = keeper.TakeLeft();
  const RenderSettings settings = ConfiguredSettings(loaded.config);
  if (left && BringBack(*left, configured, settings, session, paths, cancelled)) return;
  LoadConfigured(loaded, session, cancelled);
}

}  // namespace palpate
