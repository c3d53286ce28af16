#include "server/app/daemon.h"

#include <spdlog/spdlog.h>
#include <csignal>

#include <memory>

#include "common/error/error.h"
#include "server/app/state_folder.h"
#include "server/device/explore_script.h"
#include "server/device/press_script.h"
#include "server/device/simulated_device.h"
#include "server/recording/recording_control.h"
#include "server/rpc/server.h"
#include "server/servo/servo_loop.h"
#include "server/session/session.h"
#include "server/session/tools.h"
#include "server/session/volume_editor.h"

namespace palpate {
namespace {

sigset_t EndingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals, signal);
  return signals;
}

bool EndRequested() {
  sigset_t pending;
  sigpending(&pending);
  return sigismember(&pending, SIGINT) || sigismember(&pending, SIGTERM) ||
         sigismember(&pending, SIGHUP);
}

std::unique_ptr<HapticDevice> MakeDevice(const Config& config) {
  if (config.device != "simulated") {
    throw Error(ErrorKind::kInvalidArgument,
                "unknown device " + config.device + ": this version has `simulated` only");
  }
  constexpr std::uint64_t kSeed = 1;
  const DeviceSpec spec = SimulatedDeviceSpec();
  auto explore =
      std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, kSeed);
  return std::make_unique<SimulatedDevice>(std::make_unique<PressScript>(
      std::move(explore), static_cast<std::uint32_t>(config.pressed_buttons)));
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
}

void RunDaemon(const Config& config) {
  const std::unique_ptr<HapticDevice> device = MakeDevice(config);
  SceneInbox inbox;
  const auto outbox = std::make_unique<TickOutbox>();
  Pump pump(*outbox);
  Session session(device->spec(), inbox, pump,
                  VolumeLoader{.import_program = ImportProgram(),
                               .budget = MemoryBudget::Make(config.memory_budget_bytes)});
  RegistrationStore registrations(config.state_folder.value_or(DefaultStateFolder()));
  session.SetRegistrationStore(registrations);
  VolumeEditor editor(session);
  const auto tools = std::make_shared<StylusTools>(session, editor);
  pump.Subscribe(tools);
  ServoLoop servo(*device, inbox, *outbox, config.realtime);
  const std::string socket = config.socket_path.empty() ? DefaultSocketPath() : config.socket_path;
  const PathPolicy paths = MakePathPolicy(config);
  RecordingControl recording(session, pump,
                             {[&](const std::string& path) { return paths.CheckSave(path); },
                              [&](const std::string& path) { return paths.CheckLoad(path); }},
                             "palpated " PALPATE_VERSION);
  SeriesPlayer series(session);
  RpcServer server({socket, config.listen, paths, config.uploads},
                   {session, editor, series, recording, pump, device->spec(), servo, inbox});

  server.Reserve();
  RemoveAbandonedUploads(config.uploads);
  session.SetInitial({.haptics = config.haptics, .method = config.method});
  LoadFirstVolume(config, session);
  tools->Start();
  pump.Start();
  servo.Start();
  ReportGrant(servo.grant());
  server.Start();
  spdlog::info("ready on {}{}", socket,
               config.listen ? " and " + config.listen->ToString() : std::string());

  const sigset_t signals = EndingSignals();
  int signal = 0;
  sigwait(&signals, &signal);
  spdlog::info("ending on signal {}", signal);
  servo.Stop();
  server.Stop();
  series.Stop();
  pump.Stop();
  tools->Stop();
  recording.End();
  spdlog::info("ended after {} ticks, {} missed", servo.ticks(), servo.missed_ticks());
}

}  // namespace palpate
