#include "server/metrics/exporter.h"

#include <prometheus/exposer.h>

#include <exception>
#include <string>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

// A reader that hangs frees its thread again.
const std::vector<std::string> kOptions = {"num_threads", "2", "request_timeout_ms", "2000"};

}  // namespace

MetricsExporter::MetricsExporter(const HostPort& address) {
  HostPort literal = address;
  if (literal.host == "localhost") literal.host = "127.0.0.1";
  if (!IsLoopback(literal)) {
    throw Error(ErrorKind::kInvalidArgument,
                "[metrics] listen: will not listen on " + address.ToString() +
                    ": metrics are neither encrypted nor authorised, and only loopback addresses "
                    "are allowed (127.0.0.1, ::1)");
  }
  std::vector<std::string> options = {"listening_ports", literal.ToString()};
  options.insert(options.end(), kOptions.begin(), kOptions.end());
  try {
    exposer_ = std::make_unique<prometheus::Exposer>(options);
  } catch (const std::exception&) {
    // It does not say more than this.
    throw Error(ErrorKind::kConflict, "[metrics] listen: cannot listen on " + literal.ToString() +
                                          ": the port is in use; name another");
  }
}

MetricsExporter::~MetricsExporter() = default;

void MetricsExporter::Show(const std::shared_ptr<prometheus::Collectable>& metrics) {
  exposer_->RegisterCollectable(metrics);
}

}  // namespace palpate
