#include "server/metrics/exporter.h"

#include <prometheus/exposer.h>

#include <exception>
#include <string>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

// The timeout frees the thread of a reader that hangs.
const std::vector<std::string> kOptions = {"num_threads", "2", "request_timeout_ms", "2000"};

HostPort Literal(HostPort address) {
  if (address.host == "localhost") address.host = "127.0.0.1";
  return address;
}

}  // namespace

void CheckMetricsListen(const HostPort& address) {
  if (IsLoopback(Literal(address))) return;
  throw Error(ErrorKind::kInvalidArgument,
              "will not listen on " + address.ToString() +
                  ": metrics are neither encrypted nor authorised, and only loopback addresses "
                  "are allowed (127.0.0.1, ::1)");
}

MetricsExporter::MetricsExporter(const HostPort& address) {
  CheckMetricsListen(address);
  const HostPort literal = Literal(address);
  std::vector<std::string> options = {"listening_ports", literal.ToString()};
  options.insert(options.end(), kOptions.begin(), kOptions.end());
  try {
    exposer_ = std::make_unique<prometheus::Exposer>(options);
  } catch (const std::exception&) {
    // prometheus::Exposer gives no reason; the usual one is a port in use.
    throw Error(ErrorKind::kConflict, "cannot listen on " + literal.ToString() +
                                          ": the port is in use; give another port");
  }
}

MetricsExporter::~MetricsExporter() = default;

void MetricsExporter::Show(const std::shared_ptr<prometheus::Collectable>& metrics) {
  exposer_->RegisterCollectable(metrics);
}

prometheus::Counter& AddCounter(prometheus::Registry& registry, const std::string& name,
                                const std::string& help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry).Add({});
}

prometheus::Gauge& AddGauge(prometheus::Registry& registry, const std::string& name,
                            const std::string& help, const prometheus::Labels& labels) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(registry).Add(labels);
}

prometheus::Histogram& AddHistogram(prometheus::Registry& registry, const std::string& name,
                                    const std::string& help, const std::vector<double>& bounds) {
  return prometheus::BuildHistogram().Name(name).Help(help).Register(registry).Add({}, bounds);
}

}  // namespace palpate
