// Counters of the services for the metrics: subscribers, the age of poses when they are sent and
// acknowledged, and the time until a change is felt.
//
// Threads: any; nothing allocates. A lock is held only while counting.
// Ownership: borrows the registry; the registry owns the counters.
#pragma once

#include <cstdint>

namespace prometheus {
class Counter;
class Gauge;
class Histogram;
class Registry;
}  // namespace prometheus

namespace palpate {

class ServiceMetrics {
 public:
  explicit ServiceMetrics(prometheus::Registry& registry);

  void PoseStreamBegan();
  void PoseStreamEnded();
  // age_ns: the age of the message's newest sample. dropped: samples lost since the last message.
  void PosesSent(std::int64_t age_ns, std::uint64_t dropped);
  void PosesAcknowledged(std::int64_t age_ns);

  // From the request's arrival to the start of the first tick with the change.
  void EditFelt(std::int64_t latency_ns);
  void SettingsFelt(std::int64_t latency_ns);

 private:
  prometheus::Gauge& pose_streams_;
  prometheus::Counter& dropped_samples_;
  prometheus::Histogram& age_sent_;
  prometheus::Histogram& age_acknowledged_;
  prometheus::Histogram& edit_latency_;
  prometheus::Histogram& settings_latency_;
};

}  // namespace palpate
