// Sums up the servo's ticks for the metrics.
//
// It counts on the pump thread, from samples that the pump drains anyway. The servo thread does no
// work for it.
//
// Threads: OnSample on the pump's; any thread may read the registry. OnSample does not allocate. It
// waits at most as long as a reader takes to copy one histogram.
// Ownership: borrows the registry.
#pragma once

#include <cstdint>

#include "server/pump/pump.h"

namespace prometheus {
class Counter;
class Gauge;
class Histogram;
class Registry;
}  // namespace prometheus

namespace palpate {

class ServoMetrics final : public SampleSink {
 public:
  explicit ServoMetrics(prometheus::Registry& registry);

  void OnSample(const TickSample& sample) override;

 private:
  void CountTick(const TickSample& sample);

  prometheus::Histogram& period_;
  prometheus::Histogram& update_;
  prometheus::Histogram& force_;
  prometheus::Counter& ticks_;
  prometheus::Counter& missed_;
  prometheus::Counter& contact_;
  prometheus::Counter& contact_faults_;
  prometheus::Counter& faulty_;
  prometheus::Counter& capped_;
  prometheus::Counter& saturated_;
  prometheus::Gauge& force_limit_;
  prometheus::Gauge& settings_revision_;
  prometheus::Gauge& volume_revision_;

  // Of the last sample; 0: no sample yet.
  std::int64_t time_ns_ = 0;
  std::uint64_t tick_ = 0;
  std::uint64_t missed_ticks_ = 0;
  std::uint64_t faulty_ticks_ = 0;
  std::uint64_t capped_ticks_ = 0;
};

}  // namespace palpate
