// What the services count for the metrics: who is subscribed, how old poses are when
// they leave and when they are acknowledged, and how long changes take to be felt.
//
// Threads: any; nothing allocates, and no lock is held longer than it takes to count.
// Ownership: owns the registry's contents through the registry that it borrows.
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
  // age_ns: of the message's newest sample; dropped: samples lost since the message
  // before.
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
