#include "server/metrics/service_metrics.h"

#include "server/metrics/exporter.h"

namespace palpate {
namespace {

const std::vector<double> kLatencyBounds_s = {0.0002, 0.0005, 0.001, 0.002, 0.003, 0.005, 0.01,
                                              0.02,   0.05,   0.1,   0.2,   0.5,   1.0,   5.0};

// The time may be negative: the first tick may have begun before the request was read.
double Seconds(std::int64_t ns) { return ns > 0 ? static_cast<double>(ns) * 1e-9 : 0.0; }

}  // namespace

ServiceMetrics::ServiceMetrics(prometheus::Registry& registry)
    : pose_streams_(AddGauge(registry, "palpate_pose_streams", "Subscribers of poses")),
      dropped_samples_(AddCounter(registry, "palpate_dropped_samples_total",
                                  "Samples that subscribers of poses lost because they were slow")),
      age_sent_(AddHistogram(registry, "palpate_pose_age_sent_seconds",
                             "Age of a message's newest sample when it is handed to gRPC",
                             kLatencyBounds_s)),
      age_acknowledged_(AddHistogram(
          registry, "palpate_pose_age_acknowledged_seconds",
          "Age of a message's newest sample when its acknowledgement arrives", kLatencyBounds_s)),
      edit_latency_(AddHistogram(registry, "palpate_edit_latency_seconds",
                                 "From the arrival of an edit to the first tick with it",
                                 kLatencyBounds_s)),
      settings_latency_(AddHistogram(registry, "palpate_settings_latency_seconds",
                                     "From the arrival of settings to the first tick with them",
                                     kLatencyBounds_s)) {}

void ServiceMetrics::PoseStreamBegan() { pose_streams_.Increment(); }
void ServiceMetrics::PoseStreamEnded() { pose_streams_.Decrement(); }

void ServiceMetrics::PosesSent(std::int64_t age_ns, std::uint64_t dropped) {
  age_sent_.Observe(Seconds(age_ns));
  dropped_samples_.Increment(static_cast<double>(dropped));
}

void ServiceMetrics::PosesAcknowledged(std::int64_t age_ns) {
  age_acknowledged_.Observe(Seconds(age_ns));
}

void ServiceMetrics::EditFelt(std::int64_t latency_ns) {
  edit_latency_.Observe(Seconds(latency_ns));
}

void ServiceMetrics::SettingsFelt(std::int64_t latency_ns) {
  settings_latency_.Observe(Seconds(latency_ns));
}

}  // namespace palpate
