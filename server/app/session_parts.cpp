#include "server/app/session_parts.h"

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <thread>
#include <vector>

#include "common/wire/address.h"
#include "server/log/log.h"
#include "server/servo/tick_computation.h"
#include "server/session/setting_checks.h"
#include "server/simulated_hand/simulated_device.h"

namespace palpate {
namespace {

// Empty if the variable is not set or holds no absolute path. Both systemd and the XDG base
// directory specification ask for absolute paths.
std::string Folder(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr && value[0] == '/' ? value : "";
}

std::string DefaultStateFolder() {
  const std::string state = Folder("STATE_DIRECTORY");
  if (!state.empty()) return state.substr(0, state.find(':'));
  const std::string xdg = Folder("XDG_STATE_HOME");
  if (!xdg.empty()) return xdg + "/palpate";
  const std::string home = Folder("HOME");
  return home.empty() ? "" : home + "/.local/state/palpate";
}

OwnFiles OwnFilesOf(const LoadedConfig& loaded, const std::filesystem::path& state_folder,
                    const std::string& socket) {
  const SecurityOptions& security = loaded.config.security;
  std::vector<std::filesystem::path> own{socket + ".tls"};
  for (const Role role : {Role::kViewer, Role::kEditor, Role::kOperator, Role::kAdmin}) {
    own.emplace_back(RoleSocketPath(socket, role) + ".lock");
    own.emplace_back(StopSocketPath(RoleSocketPath(socket, role)) + ".lock");
    own.emplace_back(DoorSocketPath(socket, role) + ".lock");
  }
  own.emplace_back(DoorStopPath(socket) + ".lock");
  // Not the whole folder: recordings may lie below it. The service's recordings do.
  if (!state_folder.empty()) {
    for (const char* name : {"sessions", "faults", "registrations.toml", "registrations.toml.lock",
                             "registrations.toml.damaged"}) {
      own.push_back(std::filesystem::absolute(state_folder) / name);
    }
  }
  for (const std::filesystem::path& path :
       {loaded.file, security.policy.tokens, security.policy.client_ca, security.tls.certificate,
        security.tls.key}) {
    if (!path.empty()) own.push_back(std::filesystem::absolute(path));
  }
  return OwnFiles(own);
}

PathPolicy PolicyOf(const Config& config, const OwnFiles& own_files) {
  const auto or_current = [](const std::optional<std::vector<std::filesystem::path>>& folders) {
    return folders ? *folders : std::vector{CurrentFolder()};
  };
  return PathPolicy({.load_folders = or_current(config.load_folders),
                     .save_folders = or_current(config.save_folders),
                     .own_files = own_files});
}

}  // namespace

DaemonPaths::DaemonPaths(const LoadedConfig& loaded)
    : state_folder(loaded.config.state_folder.value_or(DefaultStateFolder())),
      socket(loaded.config.socket_path.empty() ? DefaultSocketPath() : loaded.config.socket_path),
      own_files(OwnFilesOf(loaded, state_folder, socket)),
      clients(PolicyOf(loaded.config, own_files)) {}

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

LoadRequest ConfiguredVolume(const Config& config) {
  LoadRequest request = config.volume;
  request.source = Source(config.volume.source);
  request.title = Name(config.volume.source);
  return request;
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

RenderSettings ConfiguredSettings(const Config& config) { return {.haptics = config.haptics}; }

// Restores the volume of the previous daemon. Otherwise loads the configured volume, also if the
// restore fails or if `paths` no longer allows the session's volume. The log and the volume's
// warnings say why. Tells the progress to the session's first_load(), as a line for people to
// `on_progress`, and every five seconds to the log.
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

// Takes it, and sets its settings. Call it before any client can set others.
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

// Clients that wait for the volume ask five times a second.
constexpr std::chrono::milliseconds kLastAnswers{500};

std::filesystem::path ImportProgram() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "palpate-import";
}

}  // namespace

SessionParts::SessionParts(const LoadedConfig& loaded, const DaemonPaths& paths,
                           Instrument& instrument)
    : loaded_(loaded),
      paths_(paths),
      instrument_(instrument),
      registrations_(paths.state_folder),
      session(instrument.device->spec(), instrument.inbox, instrument.pump,
              VolumeLoader{
                  .import_program = ImportProgram(),
                  .folders = paths.clients.load_folders(),
                  .own_files = paths.own_files,
                  .budget = MemoryBudget::Make(loaded.config.memory_budget_bytes, LiveBrickBytes)}),
      editor(session),
      recording(session, instrument.pump,
                {[&](const std::string& path) { return paths.clients.CheckSave(path); },
                 [&](const std::string& path) { return paths.clients.OpenToLoad(path); },
                 paths.clients.save_folders()},
                "palpated " PALPATE_VERSION, instrument.limits, PassivityDeviceOf(session.device()),
                [](const std::string& line, bool is_error) {
                  is_error ? LogError("{}", line) : LogWarning("{}", line);
                }),
      series(session),
      tools_(std::make_shared<StylusTools>(session, editor)),
      keeper_(paths.state_folder, paths.socket, ConfiguredVolume(loaded.config),
              ConfiguredSettings(loaded.config), [this] { return session.Felt(); }) {
  session.SetRegistrationStore(registrations_);
  session.SetKeeper(keeper_);
  session.SetInitial(ConfiguredSettings(loaded.config));
  instrument.pump.Subscribe(tools_);
  if (session.device().kind != SimulatedDeviceSpec().kind) return;
  hand_guide_.emplace(session, instrument.hand.plans);
  session.SetBeforeOtherVolume(
      [this](const HapticSurface& surface) { hand_guide_->MakeRoomFor(surface); });
}

SessionParts::~SessionParts() {
  session.store().TellEdits({});
  instrument_.servo.Stop();
  series.Stop();
  instrument_.pump.Stop();
}

void SessionParts::TakeLeft() { left_ = palpate::TakeLeft(loaded_.config, session, keeper_); }

bool SessionParts::LoadFirst(const std::function<void(const std::string&)>& on_progress,
                             const LoadCancelled& end_requested) {
  try {
    LoadFirstVolume(loaded_, session, left_, keeper_.ended_cleanly(), paths_.clients, on_progress,
                    end_requested);
  } catch (const Error& error) {
    keeper_.GiveBack();  // an end in order
    if (error.kind() != ErrorKind::kCancelled || !end_requested()) {
      session.first_load().Fail(error);
      if (session.first_load().was_asked()) std::this_thread::sleep_for(kLastAnswers);
      throw;
    }
    LogInfo("ended by a signal while the volume was loading");
    return false;
  }
  session.AwaitPlaceKept();  // before the session that names the volume
  tools_->Start();
  if (hand_guide_) hand_guide_->Start();
  keeper_.Start();
  session.store().TellEdits([this](std::uint64_t edits) { keeper_.NoteEdits(edits); });
  return true;
}

void SessionParts::End() {
  series.Stop();
  instrument_.pump.Stop();
  tools_->Stop();
  if (hand_guide_) hand_guide_->Stop();
  recording.End();
  session.store().TellEdits({});
  keeper_.End();
  if (const VolumeState last = session.volume(); last.unsaved_edits > 0) {
    LogWarning("edits of {} that were not saved are lost: {}", last.volume->metadata().source,
               last.unsaved_edits);
  }
}

}  // namespace palpate
