// Serves the metrics to Prometheus: HTTP, /metrics, loopback only; and makes one metric in one
// line.
//
// Threads: main; two threads of its own answer requests.
// Errors: Error: kInvalidArgument for an address that is not loopback, kConflict if the port is in
// use.
#pragma once

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <memory>
#include <string>
#include <vector>

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

// Adds one histogram, counter or gauge to a registry in one line.

prometheus::Counter& AddCounter(prometheus::Registry& registry, const std::string& name,
                                const std::string& help);
prometheus::Gauge& AddGauge(prometheus::Registry& registry, const std::string& name,
                            const std::string& help, const prometheus::Labels& labels = {});
// bounds: upper bounds, ascending. The last bucket, which has no bound, is added automatically.
prometheus::Histogram& AddHistogram(prometheus::Registry& registry, const std::string& name,
                                    const std::string& help, const std::vector<double>& bounds);

}  // namespace palpate
