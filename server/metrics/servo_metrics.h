// What the ticks of the servo add up to, for the metrics.
//
// It counts on the pump thread, from the samples that are drained anyway: the servo
// thread does nothing for it.
//
// Threads: OnSample on the pump's; the registry is read on any. OnSample neither
// allocates nor waits longer than a reader takes to copy one histogram.
// Ownership: borrows the registry.
#pragma once

#include <cstdint>

#include "server/samples/pump.h"

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

  // Of the sample before; 0: none yet.
  std::int64_t time_ns_ = 0;
  std::uint64_t tick_ = 0;
  std::uint64_t missed_ticks_ = 0;
  std::uint64_t faulty_ticks_ = 0;
  std::uint64_t capped_ticks_ = 0;
};

}  // namespace palpate
