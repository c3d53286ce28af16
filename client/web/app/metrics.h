// The metrics of palpate-web for Prometheus: HTTP, /metrics, loopback only.
//
// Threads: the network thread; two threads of its own answer requests.
// Errors: Error: kConflict if the port is in use.
#pragma once

#include <memory>
#include <optional>
#include <string_view>

#include "common/wire/address.h"

namespace palpate::web {

// Counters, and gauges, which are shown once they are set. Some counters have a label, by which
// they are counted apart.
enum class Metric {
  kGuests,     // gauge
  kDropped,    // by reason
  kRefused,    // by kind
  kAnswers,    // by status
  kSentBytes,  // by to: http, stream
  kSkipped,
  kBlobs,
  kSteered,       // by result: accepted, refused
  kPoseAge,       // gauge
  kCopyComplete,  // gauge
  kNatsConnected  // gauge
};

class Metrics {
 public:
  // None: they are counted and not shown.
  explicit Metrics(const std::optional<HostPort>& listen);
  ~Metrics();

  void Count(Metric metric, std::string_view label = "", double by = 1.0);
  void Set(Metric gauge, double value);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::web
