#include <prometheus/registry.h>

#include <csignal>
#include <ctime>
#include <functional>
#include <memory>
#include <optional>
#include <string_view>

#include "common/contract/enumerations.h"
#include "server/app/config_check.h"
#include "server/app/devices.h"
#include "server/app/run.h"
#include "server/app/service_manager.h"
#include "server/app/session_parts.h"
#include "server/log/log.h"
#include "server/metrics/exporter.h"
#include "server/metrics/service_metrics.h"
#include "server/metrics/state_metrics.h"
#include "server/services/server.h"

namespace palpate {
namespace {

// What others reach: the gRPC server and the page of metrics.
//
// Threads: main.
// Errors: Error; for an address, with its line of the configuration.
class ServerParts {
 public:
  // Claims the addresses, so that a second daemon fails at once. Borrows all.
  ServerParts(const LoadedConfig& loaded, const DaemonPaths& paths, Instrument& instrument,
              SessionParts& parts);

  // Call it with a running servo.
  void Start();
  // "/run/palpate/palpated.sock and localhost:7400"
  std::string Addresses() const;

 private:
  const LoadedConfig& loaded_;
  const DaemonPaths& paths_;
  const std::shared_ptr<prometheus::Registry> registry_;
  ServiceMetrics service_metrics_;

 public:
  RpcServer rpc;

 private:
  const std::shared_ptr<prometheus::Collectable> state_metrics_;
  std::shared_ptr<SampleSink> servo_metrics_;
  std::optional<MetricsExporter> exporter_;
};

// Turns an error of `attempt` into a fault of `key`.
void ForKey(const LoadedConfig& loaded, std::string_view key,
            const std::function<void()>& attempt) {
  try {
    attempt();
  } catch (const Error& error) {
    throw AtKey(loaded, key, error);
  }
}

LedHand* HandOf(Instrument& instrument) {
  return instrument.device->spec().kind == "simulated" ? &instrument.hand.led : nullptr;
}

ServerParts::ServerParts(const LoadedConfig& loaded, const DaemonPaths& paths,
                         Instrument& instrument, SessionParts& parts)
    : loaded_(loaded),
      paths_(paths),
      registry_(std::make_shared<prometheus::Registry>()),
      service_metrics_(*registry_),
      rpc({paths.socket, loaded.config.groups, loaded.config.listen, paths.clients,
           loaded.config.uploads, loaded.config.security},
          {parts.session, parts.editor, parts.series, parts.recording, instrument.pump,
           *instrument.device, HandOf(instrument), instrument.servo, instrument.stop_door,
           instrument.inbox, instrument.forces, DeviceListOf(loaded.config.device),
           service_metrics_}),
      state_metrics_(std::make_shared<StateMetrics>(
          MeasuredParts{instrument.servo, *instrument.device, instrument.forces, parts.recording,
                        *parts.session.loader().budget, loaded.config.memory_budget_bytes,
                        [this] { return rpc.volume_streams(); }})) {
  ForKey(loaded, "server.socket", [&] { rpc.Reserve(); });
  ForKey(loaded, "server.listen", [&] { rpc.ReservePort(); });
  if (!loaded.config.metrics_listen) return;
  ForKey(loaded, "metrics.listen", [&] { exporter_.emplace(*loaded.config.metrics_listen); });
  servo_metrics_ = std::make_shared<ServoMetrics>(*registry_);
  instrument.pump.Subscribe(servo_metrics_);
}

void ServerParts::Start() {
  rpc.Start();
  if (!exporter_) return;
  exporter_->Show(registry_);
  exporter_->Show(state_metrics_);
  LogInfo("metrics on http://{}/metrics", loaded_.config.metrics_listen->ToString());
}

std::string ServerParts::Addresses() const {
  const std::optional<HostPort>& listen = loaded_.config.listen;
  return paths_.socket + (listen ? " and " + listen->ToString() : "");
}

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

std::string StatusLine(const Instrument& instrument, const Session& session) {
  const std::optional<ForceTick> newest = instrument.forces.newest();
  return fmt::format("{}, forces {}; {}", instrument.device->spec().kind,
                     newest ? NameOf(newest->forces.state) : "off",
                     session.volume().volume->metadata().source);
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
  ServiceManager manager;
  const DaemonPaths paths(loaded);
  Instrument instrument(loaded.config, paths.state_folder);
  SessionParts parts(loaded, paths, instrument);
  ServerParts server(loaded, paths, instrument, parts);
  RemoveAbandonedUploads(loaded.config.uploads);
  instrument.Start();
  parts.TakeLeft();
  server.Start();
  const auto on_progress = [&](const std::string& line) { manager.Status(line); };
  if (!parts.LoadFirst(on_progress, [&] { return EndRequested(!read); })) return;
  LogInfo("ready on {}", server.Addresses());
  ConfigReload reload(loaded, read, parts.session, [&](const PolicyOptions& policy) {
    return server.rpc.PrepareSecurity(policy);
  });
  manager.Ready();
  const int signal = Serve(manager, instrument.servo, reload,
                           [&] { return StatusLine(instrument, parts.session); });
  // The servo stops before the log is written: a log that nobody reads may block.
  instrument.servo.Stop();
  manager.Stopping();
  LogInfo("ending on signal {}", signal);
  server.rpc.Stop();
  parts.End();
  LogInfo("ended after {} ticks, {} missed", instrument.servo.ticks(),
          instrument.servo.missed_ticks());
}

}  // namespace palpate
