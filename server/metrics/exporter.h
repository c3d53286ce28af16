// Serves the metrics to Prometheus: HTTP, /metrics, loopback only.
//
// Threads: main; two threads of its own answer requests.
// Errors: Error: kInvalidArgument for an address that is not loopback, kConflict if the port is in
// use.
#pragma once

#include <memory>

#include "common/wire/address.h"

namespace prometheus {
class Collectable;
class Exposer;
}  // namespace prometheus

namespace palpate {

// Throws kInvalidArgument for an address that is not loopback: metrics are neither
// encrypted nor authorised.
void CheckMetricsListen(const HostPort& address);

class MetricsExporter {
 public:
  explicit MetricsExporter(const HostPort& address);
  ~MetricsExporter();

  // Shows these metrics from now on. The caller keeps them alive: they disappear when the last
  // owner releases them.
  void Show(const std::shared_ptr<prometheus::Collectable>& metrics);

 private:
  std::unique_ptr<prometheus::Exposer> exposer_;
};

}  // namespace palpate
