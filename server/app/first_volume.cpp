#include "server/app/first_volume.h"

#include <chrono>
#include <filesystem>

#include "server/log/log.h"
#include "server/session/held_tool.h"
#include "server/session/range.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kLogEvery{5};

bool IsBuiltin(const std::string& volume) { return volume.starts_with("builtin:"); }

std::string Name(const std::string& volume) {
  return IsBuiltin(volume) ? volume : std::filesystem::absolute(volume).string();
}

// Follows links: the administrator's configuration may name any file.
std::string Source(const std::string& volume) {
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(volume, error);
  return IsBuiltin(volume) || error ? Name(volume) : real.string();
}

using Progress = std::function<void(const std::string&)>;

void Load(const LoadRequest& request, Session& session, const Progress& on_progress,
          const LoadCancelled& cancelled) {
  LogInfo("loading {}", request.source);
  const std::string name = IsBuiltin(request.source)
                               ? request.source
                               : std::filesystem::path(request.source).filename().string();
  auto logged = std::chrono::steady_clock::now();
  const auto tell = [&](std::string_view stage, double fraction) {
    const std::string line = fmt::format("loading {}, {:.0f} %", name, 100.0 * fraction);
    session.first_load().Tell(line);
    on_progress(line);
    if (std::chrono::steady_clock::now() - logged < kLogEvery) return;
    logged = std::chrono::steady_clock::now();
    LogInfo("{} ({})", line, stage);
  };
  const VolumeState state = session.Load(request, tell, cancelled);
  const VolumeMetadata& m = state.volume->metadata();
  LogInfo("volume {}x{}x{} {}, spacing {:g} x {:g} x {:g} mm, values {:g} to {:g} {}", m.size.x(),
          m.size.y(), m.size.z(), m.original_type, m.spacing_mm.x(), m.spacing_mm.y(),
          m.spacing_mm.z(), m.value_min, m.value_max, m.unit);
  const bool is_chosen = !request.isovalue && !request.normalized_isovalue;
  LogInfo("scale {:.4g} device mm per volume mm; isovalue {:g}{}{}",
          state.registration.device_mm_per_volume_mm, state.isovalue,
          m.unit.empty() ? "" : " " + m.unit,
          is_chosen ? " (" + state.values->suggested.front().reason + ")" : "");
}

// Loads the configured volume. An error names the configuration's line.
void LoadConfigured(const LoadedConfig& loaded, const std::string& warning, Session& session,
                    const Progress& on_progress, const LoadCancelled& cancelled) {
  LoadRequest request = ConfiguredVolume(loaded.config);
  request.warning = warning;
  try {
    Load(request, session, on_progress, cancelled);
  } catch (const RangeError& error) {
    throw AtKey(loaded, "volume.isovalue", error);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kCancelled) throw;
    throw AtKey(loaded, "volume.source", error);
  }
}

// The paths of a client's volume are checked against `paths`. The configured volume's are not.
LoadRequest VolumeLeft(const FeltSession& left, const LoadRequest& configured,
                       const std::string& warning, const PathPolicy& paths) {
  LoadRequest request = left.volume;
  request.free_side = left.settings.haptics.free_side;
  request.warning = warning;
  if (request.source != configured.source) request.source = paths.CheckLoad(request.source);
  return request;
}

// The left session's free side may have been that of a level set that is not restored. Returns
// what becomes of the settings, in words.
std::string LeaveSide(const FeltSession& left, const RenderSettings& configured, Session& session) {
  RenderSettings settings = left.settings;
  settings.haptics.free_side = configured.haptics.free_side;
  try {
    if (session.SetInitial(settings)) return "its settings do, but for the isovalue";
    return "nor do its settings, because a client has set others";
  } catch (const Error&) {
    return "nor do its settings";
  }
}

// Returns why the session's volume is not restored, in words for clients; "" if it is.
std::string BringBack(const SessionLeft& left, const LoadRequest& configured,
                      const RenderSettings& configured_settings, const std::string& warning,
                      Session& session, const PathPolicy& paths, const Progress& on_progress,
                      const LoadCancelled& cancelled) {
  const FeltSession& felt = *left.felt;
  std::string why = "uploads and series are loaded again by clients";
  if (!left.bad_settings.empty()) {
    why = left.bad_settings;
  } else if (!felt.volume.source.empty()) {
    try {
      Load(VolumeLeft(felt, configured, warning, paths), session, on_progress, cancelled);
      return "";
    } catch (const Error& error) {
      if (error.kind() == ErrorKind::kCancelled) throw;
      why = error.what();
    }
  }
  return fmt::format("{} does not come back, {}: {}", felt.volume.title,
                     LeaveSide(felt, configured_settings, session), why);
}

void Append(const std::string& line, std::string& warning) {
  if (!line.empty()) warning += (warning.empty() ? "" : "; ") + line;
}

}  // namespace

LoadRequest ConfiguredVolume(const Config& config) {
  LoadRequest request = config.volume;
  request.source = Source(config.volume.source);
  request.title = Name(config.volume.source);
  return request;
}

RenderSettings ConfiguredSettings(const Config& config) { return {.haptics = config.haptics}; }

SessionLeft TakeLeft(const Config& config, Session& session, SessionKeeper& keeper) {
  SessionLeft left{.felt = keeper.TakeLeft(config.fresh)};
  if (keeper.lost_edits() > 0) {
    left.lost = fmt::format("palpated {}; edits that are lost: {}",
                            keeper.ended_cleanly() ? "was ended" : "did not end cleanly",
                            keeper.lost_edits());
  }
  if (!keeper.why_not().empty()) {
    Append("the previous session does not come back: " + keeper.why_not(), left.lost);
  }
  if (!left.felt) return left;
  HapticSettings& haptics = left.felt->settings.haptics;
  try {
    CheckHeld(haptics, session.device());
  } catch (const Error& error) {
    // The device, or a configuration that was changed since, forbids it.
    LogWarning("the tool does not come back: {}", error.what());
    Append(std::string("the tool does not come back: ") + error.what(), left.lost);
    haptics.tool = {};
  }
  try {
    session.SetInitial(left.felt->settings);
  } catch (const Error& error) {
    left.bad_settings = error.what();
  }
  return left;
}

void LoadFirstVolume(const LoadedConfig& loaded, Session& session, const SessionLeft& left,
                     bool ended_cleanly, const PathPolicy& paths, const Progress& on_progress,
                     const LoadCancelled& cancelled) {
  const LoadRequest configured = ConfiguredVolume(loaded.config);
  std::string warning = left.lost;
  if (left.felt) {
    const std::string why_not = BringBack(left, configured, ConfiguredSettings(loaded.config),
                                          warning, session, paths, on_progress, cancelled);
    if (why_not.empty()) {
      const std::string back = left.felt->volume.title + " and the settings are back";
      ended_cleanly ? LogInfo("{}; --fresh starts as configured", back)
                    : LogWarning("the previous palpated did not end cleanly: {}", back);
      return;
    }
    LogWarning("{}", why_not);
    Append(why_not, warning);
  }
  LoadConfigured(loaded, warning, session, on_progress, cancelled);
}

}  // namespace palpate
