#include "server/app/daemon.h"

#include <spdlog/spdlog.h>
#include <csignal>

#include <memory>

#include "common/error/error.h"
#include "server/app/device_monitor.h"
#include "server/app/devices.h"
#include "server/app/state_folder.h"
#include "server/recording/black_box.h"
#include "server/recording/recording_control.h"
#include "server/rpc/server.h"
#include "server/servo/servo_loop.h"
#include "server/session/force_watch.h"
#include "server/session/session.h"
#include "server/session/tools.h"
#include "server/session/volume_editor.h"

namespace palpate {
namespace {

sigset_t EndingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) sigaddset(&signals, signal);
  return signals;
}

bool EndRequested() {
  sigset_t pending;
  sigpending(&pending);
  return sigismember(&pending, SIGINT) || sigismember(&pending, SIGTERM) ||
         sigismember(&pending, SIGHUP) || sigismember(&pending, SIGQUIT);
}

std::filesystem::path ImportProgram() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "palpate-import";
}

std::string Source(const std::string& volume) {
  return volume.starts_with("builtin:") ? volume : std::filesystem::absolute(volume).string();
}

PathPolicy MakePathPolicy(const Config& config) {
  PathPolicyOptions options{.load_folders = config.load_folders};
  options.save_folders = config.save_folders ? *config.save_folders : std::vector{CurrentFolder()};
  return PathPolicy(options);
}

void LoadFirstVolume(const Config& config, Session& session) {
  LoadRequest request;
  request.source = Source(config.volume);
  request.isovalue = config.isovalue;
  request.normalized_isovalue = config.normalized_isovalue;
  request.spacing_mm = config.spacing_mm;
  request.device_mm_per_volume_mm = config.device_mm_per_volume_mm;
  spdlog::info("loading {}", request.source);
  const auto quiet = [](std::string_view, double) {};
  const VolumeState state = session.Load(request, quiet, EndRequested);
  const VolumeMetadata& m = state.volume->metadata();
  spdlog::info("volume {}x{}x{} {}, spacing {:g} x {:g} x {:g} mm, values {:g} to {:g} {}",
               m.size.x(), m.size.y(), m.size.z(), m.original_type, m.spacing_mm.x(),
               m.spacing_mm.y(), m.spacing_mm.z(), m.value_min, m.value_max, m.unit);
  const RenderSettings settings = session.settings().settings;
  spdlog::info("scale {:.4g} device mm per volume mm; isovalue {:g} (normalized {:.4g})",
               state.registration.device_mm_per_volume_mm, settings.isovalue,
               settings.normalized_isovalue);
}

void LogBlackBox(const std::string& text, bool is_error) {
  spdlog::log(is_error ? spdlog::level::err : spdlog::level::info, "{}", text);
}

// What there is to say of hardware before it moves.
void ReportDevice(const DeviceSpec& spec) {
  if (!IsHardware(spec)) return;
  spdlog::warn("device {}: verification level {}; forces are off until `palpate device enable {}`",
               spec.kind, NameOf(spec.verification_level), spec.kind);
}

void ReportGrant(const RealtimeGrant& grant) {
  for (const std::string& warning : grant.warnings) spdlog::warn("{}", warning);
  spdlog::info("servo loop at 1000 Hz, {} scheduling, memory {}",
               grant.fifo ? "SCHED_FIFO" : "ordinary",
               grant.memory_locked ? "locked" : "not locked");
}

}  // namespace

void BlockEndingSignals() {
  const sigset_t signals = EndingSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  // Stopped, it would leave the last force on the motors.
  for (int signal : {SIGTSTP, SIGTTIN, SIGTTOU}) std::signal(signal, SIG_IGN);
}

void RunDaemon(const Config& config) {
  // Its thread gives way to the servo.
  const std::unique_ptr<HapticDevice> device =
      MakeDevice(config.device, config.realtime.priority - 1);
  const std::filesystem::path state_folder = config.state_folder.value_or(DefaultStateFolder());
  SceneInbox inbox;
  const auto outbox = std::make_unique<TickOutbox>();
  Pump pump(*outbox);
  Session session(device->spec(), inbox, pump,
                  VolumeLoader{.import_program = ImportProgram(),
                               .budget = MemoryBudget::Make(config.memory_budget_bytes)});
  RegistrationStore registrations(state_folder);
  session.SetRegistrationStore(registrations);
  VolumeEditor editor(session);
  const auto tools = std::make_shared<StylusTools>(session, editor);
  pump.Subscribe(tools);
  const auto monitor = std::make_shared<DeviceMonitor>(*device);
  pump.Subscribe(monitor);
  const auto black_box = std::make_shared<BlackBox>(
      state_folder.empty() ? state_folder : state_folder / "faults", LogBlackBox);
  pump.Subscribe(black_box);
  const SafetyLimits limits = LimitsFor(device->spec(), StopButtons(config.device, device->spec()));
  const auto forces = std::make_shared<ForceWatch>();
  pump.Subscribe(forces);
  ServoLoop servo(*device, inbox, *outbox, config.realtime, limits);
  const std::string socket = config.socket_path.empty() ? DefaultSocketPath() : config.socket_path;
  const PathPolicy paths = MakePathPolicy(config);
  RecordingControl recording(session, pump,
                             {[&](const std::string& path) { return paths.CheckSave(path); },
                              [&](const std::string& path) { return paths.CheckLoad(path); }},
                             "palpated " PALPATE_VERSION, limits);
  SeriesPlayer series(session);
  RpcServer server({socket, config.listen, paths, config.uploads},
                   {session, editor, series, recording, pump, *device, servo, inbox, *forces,
                    [&config] { return ListDevices(config.device); }});

  server.Reserve();
  RemoveAbandonedUploads(config.uploads);
  session.SetInitial({.haptics = config.haptics, .method = config.method});
  LoadFirstVolume(config, session);
  tools->Start();
  monitor->Start();
  black_box->Start();
  pump.Start();
  servo.Start();
  ReportGrant(servo.grant());
  ReportDevice(device->spec());
  server.Start();
  spdlog::info("ready on {}{}", socket,
               config.listen ? " and " + config.listen->ToString() : std::string());

  const sigset_t signals = EndingSignals();
  int signal = 0;
  sigwait(&signals, &signal);
  // Before all else: a log that nobody reads may block.
  servo.Stop();
  spdlog::info("ending on signal {}", signal);
  server.Stop();
  series.Stop();
  pump.Stop();
  tools->Stop();
  monitor->Stop();
  black_box->Stop();
  recording.End();
  spdlog::info("ended after {} ticks, {} missed", servo.ticks(), servo.missed_ticks());
}

}  // namespace palpate
