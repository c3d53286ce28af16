// What others reach: the gRPC server and the page of metrics.
//
// Threads: main.
// Errors: Error; for an address, with its line of the configuration.
#pragma once

#include <memory>
#include <optional>

#include "server/app/session_parts.h"
#include "server/metrics/exporter.h"
#include "server/metrics/service_metrics.h"
#include "server/services/server.h"

namespace palpate {

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

}  // namespace palpate
