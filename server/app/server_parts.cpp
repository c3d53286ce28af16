#include "server/app/server_parts.h"

#include <prometheus/registry.h>

#include <functional>
#include <string_view>

#include "server/app/config_check.h"
#include "server/app/devices.h"
#include "server/log/log.h"
#include "server/metrics/servo_metrics.h"
#include "server/metrics/state_metrics.h"

namespace palpate {
namespace {

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

}  // namespace

ServerParts::ServerParts(const LoadedConfig& loaded, const DaemonPaths& paths,
                         Instrument& instrument, SessionParts& parts)
    : loaded_(loaded),
      paths_(paths),
      registry_(std::make_shared<prometheus::Registry>()),
      service_metrics_(*registry_),
      rpc({paths.socket, loaded.config.listen, paths.clients, loaded.config.uploads,
           loaded.config.security},
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

}  // namespace palpate
