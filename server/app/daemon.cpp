#include "server/app/daemon.h"

#include <prometheus/registry.h>
#include <csignal>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <functional>
#include <memory>
#include <string_view>

#include "common/error/error.h"
#include "server/app/device_monitor.h"
#include "server/app/devices.h"
#include "server/app/first_volume.h"
#include "server/app/hand_guide.h"
#include "server/app/service_manager.h"
#include "server/app/state_folder.h"
#include "server/device/simulated_device.h"
#include "server/log/log.h"
#include "server/metrics/exporter.h"
#include "server/metrics/service_metrics.h"
#include "server/metrics/servo_metrics.h"
#include "server/metrics/state_metrics.h"
#include "server/recording/black_box.h"
#include "server/recording/recording_control.h"
#include "server/rpc/server.h"
#include "server/safety/names.h"
#include "server/samples/force_watch.h"
#include "server/servo/servo_loop.h"
#include "server/servo/tick_computation.h"
#include "server/session/session.h"
#include "server/session/tools.h"
#include "server/session/volume_editor.h"
#include "server/state/session_keeper.h"

namespace palpate {
namespace {

sigset_t Signals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) sigaddset(&signals, signal);
  return signals;
}

// Used while a volume loads. A reload waits until the load ends.
bool EndRequested(bool hangup_ends) {
  sigset_t pending;
  sigpending(&pending);
  return sigismember(&pending, SIGINT) || sigismember(&pending, SIGTERM) ||
         (hangup_ends && sigismember(&pending, SIGHUP)) || sigismember(&pending, SIGQUIT);
}

std::filesystem::path ImportProgram() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "palpate-import";
}

// Files of the daemon that clients may neither load nor overwrite.
OwnFiles OwnFilesOf(const LoadedConfig& loaded, const std::filesystem::path& state_folder,
                    const std::string& socket) {
  const SecurityOptions& security = loaded.config.security;
  std::vector<std::filesystem::path> own{socket + ".tls", socket + ".lock"};
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

PathPolicy MakePathPolicy(const Config& config, const OwnFiles& own_files) {
  const auto or_current = [](const std::optional<std::vector<std::filesystem::path>>& folders) {
    return folders ? *folders : std::vector{CurrentFolder()};
  };
  return PathPolicy({.load_folders = or_current(config.load_folders),
                     .save_folders = or_current(config.save_folders),
                     .own_files = own_files});
}

void LogBlackBox(const std::string& text, bool is_error) {
  Log(is_error ? LogLevel::kError : LogLevel::kInfo, "{}", text);
}

// Turns an error of `attempt` into a fault of `key`.
void ForKey(const LoadedConfig& loaded, std::string_view key,
            const std::function<void()>& attempt) {
  try {
    attempt();
  } catch (const Error& error) {
    throw AtKey(loaded, key, error);
  }
}

// Logs what the operator must know before the hardware moves.
void ReportDevice(const DeviceSpec& spec) {
  if (!IsHardware(spec)) return;
  LogWarning("device {}: verification level {}; forces are off until `palpate device enable {}`",
             spec.kind, NameOf(spec.verification_level), spec.kind);
}

void ReportGrant(const RealtimeGrant& grant) {
  for (const std::string& warning : grant.warnings) LogWarning("{}", warning);
  LogInfo("servo loop at 1000 Hz, {} scheduling, memory {}", grant.fifo ? "SCHED_FIFO" : "ordinary",
          grant.memory_locked ? "locked" : "not locked");
}

std::string StatusLine(const HapticDevice& device, const ForceWatch& forces,
                       const Session& session) {
  const std::optional<ForceTick> newest = forces.newest();
  return fmt::format("{}, forces {}; {}", device.spec().kind,
                     newest ? NameOf(newest->state) : "off",
                     session.volume().volume->metadata().source);
}

// Returns false if a signal ends the daemon before the volume is loaded.
bool LoadFirst(const std::function<void()>& load, SessionKeeper& keeper,
               const LoadCancelled& end_requested) {
  try {
    load();
    return true;
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kCancelled || !end_requested()) throw;
  }
  keeper.GiveBack();
  LogInfo("ended by a signal while the volume was loading");
  return false;
}

// Runs until a signal ends the daemon. Returns the signal.
int Serve(ServiceManager& manager, const ServoLoop& servo, ConfigReload& reload,
          const std::function<std::string()>& status) {
  ServoWatchdog watchdog(ServiceManager::WatchdogInterval());
  const sigset_t signals = Signals();
  constexpr timespec kPeriod{0, std::chrono::nanoseconds(ServoWatchdog::kLookPeriod).count()};
  for (int period = 0;; ++period) {
    const int signal = sigtimedwait(&signals, nullptr, &kPeriod);
    if (signal == SIGHUP && reload.IsPossible()) {
      manager.Reloading();
      reload.Run();
      manager.Reloaded();
    } else if (signal > 0) {
      return signal;
    }
    if (watchdog.IsDue(servo.ticks(), std::chrono::steady_clock::now())) manager.FeedWatchdog();
    if (period % 10 == 0) manager.Status(status());
  }
}

}  // namespace

void BlockSignals() {
  const sigset_t signals = Signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  // A write beyond the file size limit then fails with an error.
  std::signal(SIGXFSZ, SIG_IGN);
  // A stopped daemon would leave the last force on the motors.
  for (int signal : {SIGTSTP, SIGTTIN, SIGTTOU}) std::signal(signal, SIG_IGN);
}

void RunDaemon(const LoadedConfig& loaded, const ConfigReader& read) {
  const Config& config = loaded.config;
  ServiceManager manager;
  TouchPlanInbox touch_plans;
  // The device's thread gets a lower priority than the servo, if there is a lower one.
  const std::unique_ptr<HapticDevice> device =
      MakeDevice(config.device, std::max(1, config.realtime.priority - 1), &touch_plans);
  const std::filesystem::path state_folder = config.state_folder.value_or(DefaultStateFolder());
  const std::string socket = config.socket_path.empty() ? DefaultSocketPath() : config.socket_path;
  const OwnFiles own_files = OwnFilesOf(loaded, state_folder, socket);
  const PathPolicy paths = MakePathPolicy(config, own_files);
  SceneInbox inbox;
  const auto outbox = std::make_unique<TickOutbox>();
  Pump pump(*outbox);
  Session session(
      device->spec(), inbox, pump,
      VolumeLoader{.import_program = ImportProgram(),
                   .folders = paths.load_folders(),
                   .own_files = own_files,
                   .budget = MemoryBudget::Make(config.memory_budget_bytes, LiveBrickBytes)});
  RegistrationStore registrations(state_folder);
  session.SetRegistrationStore(registrations);
  std::optional<HandGuide> hand_guide;
  if (device->spec().kind == SimulatedDeviceSpec().kind) {
    hand_guide.emplace(session, touch_plans);
    session.SetBeforeOtherVolume(
        [&hand_guide](const HapticSurface& surface) { hand_guide->MakeRoomFor(surface); });
  }
  VolumeEditor editor(session);
  const auto tools = std::make_shared<StylusTools>(session, editor);
  pump.Subscribe(tools);
  const auto monitor = std::make_shared<DeviceMonitor>(*device);
  pump.Subscribe(monitor);
  const auto black_box = std::make_shared<BlackBox>(
      state_folder.empty() ? state_folder : state_folder / "faults", LogBlackBox);
  pump.Subscribe(black_box);
  const SafetyLimits limits = LimitsFor(device->spec(), StopButtons(config.device, device->spec()));
  const ForceWatch forces(outbox->last);
  ServoLoop servo(*device, inbox, *outbox, config.realtime, limits);
  RecordingControl recording(session, pump,
                             {[&](const std::string& path) { return paths.CheckSave(path); },
                              [&](const std::string& path) { return paths.OpenToLoad(path); }},
                             "palpated " PALPATE_VERSION, limits, PassivityDeviceOf(device->spec()),
                             [](const std::string& line, bool is_error) {
                               is_error ? LogError("{}", line) : LogWarning("{}", line);
                             });
  SeriesPlayer series(session);
  SessionKeeper keeper(state_folder, socket, ConfiguredVolume(config), ConfiguredSettings(config),
                       [&session] { return session.Felt(); });
  const auto registry = std::make_shared<prometheus::Registry>();
  ServiceMetrics service_metrics(*registry);
  RpcServer server({socket, config.listen, paths, config.uploads, config.security},
                   {session, editor, series, recording, pump, *device, servo, inbox, forces,
                    [&config] { return ListDevices(config.device); }, service_metrics});

  ForKey(loaded, "server.socket", [&] { server.Reserve(); });
  ForKey(loaded, "server.listen", [&] { server.ReservePort(); });
  std::optional<MetricsExporter> exporter;
  if (config.metrics_listen) {
    ForKey(loaded, "metrics.listen", [&] { exporter.emplace(*config.metrics_listen); });
  }
  RemoveAbandonedUploads(config.uploads);
  manager.Loading(config.volume);
  const auto end_requested = [&] { return EndRequested(!read); };
  const auto load = [&] { LoadFirstVolume(loaded, session, keeper, paths, end_requested); };
  if (!LoadFirst(load, keeper, end_requested)) return;
  const auto servo_metrics = std::make_shared<ServoMetrics>(*registry);
  const auto state_metrics = std::make_shared<StateMetrics>(
      MeasuredParts{servo, *device, forces, recording, *session.loader().budget,
                    config.memory_budget_bytes, [&server] { return server.volume_streams(); }});
  if (exporter) pump.Subscribe(servo_metrics);
  tools->Start();
  monitor->Start();
  black_box->Start();
  if (hand_guide) hand_guide->Start();
  pump.Start();
  servo.Start();
  ReportGrant(servo.grant());
  ReportDevice(device->spec());
  keeper.Start();
  server.Start();
  if (exporter) {
    exporter->Show(registry);
    exporter->Show(state_metrics);
  }
  LogInfo("ready on {}{}", socket,
          config.listen ? " and " + config.listen->ToString() : std::string());
  if (exporter) LogInfo("metrics on http://{}/metrics", config.metrics_listen->ToString());

  ConfigReload reload(loaded, read, session,
                      [&](const PolicyOptions& policy) { return server.PrepareSecurity(policy); });
  manager.Ready();
  const int signal =
      Serve(manager, servo, reload, [&] { return StatusLine(*device, forces, session); });
  // The servo stops before the log is written: a log that nobody reads may block.
  servo.Stop();
  if (hand_guide) hand_guide->Stop();
  manager.Stopping();
  LogInfo("ending on signal {}", signal);
  exporter.reset();
  server.Stop();
  keeper.End();
  series.Stop();
  pump.Stop();
  tools->Stop();
  monitor->Stop();
  black_box->Stop();
  recording.End();
  if (const VolumeState last = session.volume(); last.unsaved_edits > 0) {
    LogWarning("edits of {} that were not saved are lost: {}", last.volume->metadata().source,
               last.unsaved_edits);
  }
  LogInfo("ended after {} ticks, {} missed", servo.ticks(), servo.missed_ticks());
}

}  // namespace palpate
