#include "client/web/app/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/exposer.h>
#include <prometheus/gauge.h>
#include <prometheus/registry.h>

#include <exception>
#include <string>
#include <vector>

#include "common/error/error.h"

namespace palpate::web {
namespace {

struct Known {
  std::string name, help, label;
  bool is_gauge = false;
};

// In the order of Metric.
const std::vector<Known>& AllKnown() {
  static const std::vector<Known> all = {
      {"guests", "Guests that watch now", "", true},
      {"guests_dropped_total", "Guests dropped, by reason", "reason"},
      {"refused_total", "Refused logins and requests, by kind", "kind"},
      {"answers_total", "HTTP answers, by status", "status"},
      {"sent_bytes_total", "Bytes of answers and of streams", "to"},
      {"poses_skipped_total", "Poses that a slow guest did not get", ""},
      {"blobs_served_total", "Groups of voxels, overviews and manifests served", ""},
      {"steered_total", "Changes of settings by guests", "result"},
      {"pose_age_seconds", "Age of the newest pose", "", true},
      {"copy_complete", "1 if the copy of the volume is complete", "", true},
      {"nats_connected", "1 if the NATS server is reached", "", true},
  };
  return all;
}

std::unique_ptr<prometheus::Exposer> Expose(HostPort address) {
  if (address.host == "localhost") address.host = "127.0.0.1";
  try {
    // The timeout frees the thread of a reader that hangs.
    return std::make_unique<prometheus::Exposer>(std::vector<std::string>{
        "listening_ports", address.ToString(), "num_threads", "2", "request_timeout_ms", "2000"});
  } catch (const std::exception&) {
    throw Error(ErrorKind::kConflict, "cannot show metrics on " + address.ToString() +
                                          ": the port is in use; give another port");
  }
}

}  // namespace

struct Metrics::Parts {
  std::shared_ptr<prometheus::Registry> registry = std::make_shared<prometheus::Registry>();
  std::vector<prometheus::Family<prometheus::Counter>*> counters;  // null: a gauge
  std::vector<prometheus::Family<prometheus::Gauge>*> gauges;      // null: a counter
  std::unique_ptr<prometheus::Exposer> exposer;
};

Metrics::Metrics(const std::optional<HostPort>& listen) : parts_(std::make_unique<Parts>()) {
  for (const Known& known : AllKnown()) {
    const std::string name = "palpate_web_" + known.name;
    prometheus::Registry& registry = *parts_->registry;
    parts_->counters.push_back(nullptr);
    parts_->gauges.push_back(nullptr);
    if (known.is_gauge) {
      parts_->gauges.back() =
          &prometheus::BuildGauge().Name(name).Help(known.help).Register(registry);
    } else {
      auto& family = prometheus::BuildCounter().Name(name).Help(known.help).Register(registry);
      parts_->counters.back() = &family;
      if (known.label.empty()) family.Add({});
    }
  }
  if (!listen) return;
  parts_->exposer = Expose(*listen);
  parts_->exposer->RegisterCollectable(parts_->registry);
}

Metrics::~Metrics() = default;

void Metrics::Count(Metric metric, std::string_view label, double by) {
  const auto place = static_cast<std::size_t>(metric);
  const std::string& name = AllKnown().at(place).label;
  prometheus::Labels labels;
  if (!name.empty()) labels.emplace(name, label);
  parts_->counters.at(place)->Add(labels).Increment(by);
}

void Metrics::Set(Metric gauge, double value) {
  parts_->gauges.at(static_cast<std::size_t>(gauge))->Add({}).Set(value);
}

}  // namespace palpate::web
