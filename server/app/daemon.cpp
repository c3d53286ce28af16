#include "server/app/daemon.h"

#include <csignal>
#include <ctime>
#include <functional>

#include "common/contract/enumerations.h"
#include "server/app/server_parts.h"
#include "server/app/service_manager.h"
#include "server/log/log.h"

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
