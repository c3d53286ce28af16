// The port from which Prometheus reads the metrics: HTTP, /metrics, loopback only.
//
// Threads: main; requests are answered on two threads of its own.
// Errors: Error: kInvalidArgument for an address that is not loopback, kConflict for a
// port in use.
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

  // Shown from now on, for as long as somebody else holds it.
  void Show(const std::shared_ptr<prometheus::Collectable>& metrics);

 private:
  std::unique_ptr<prometheus::Exposer> exposer_;
};

}  // namespace palpate
