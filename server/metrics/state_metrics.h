// The metrics of the servo's ticks, and of the daemon's state.
#pragma once

#include <prometheus/collectable.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/live_volume/memory_budget.h"
#include "server/pump/pump.h"
#include "server/pump/tick_outbox.h"
#include "server/recording/recording_control.h"
#include "server/servo/servo_loop.h"

namespace prometheus {

class Counter;
class Gauge;
class Histogram;
class Registry;

}  // namespace prometheus

namespace palpate {

// Sums up the servo's ticks for the metrics.
//
// It counts on the pump thread, from samples that the pump drains anyway. The servo thread does no
// work for it.
//
// Threads: OnSample on the pump's; any thread may read the registry. OnSample does not allocate. It
// waits at most as long as a reader takes to copy one histogram.
// Ownership: borrows the registry.
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

struct MeasuredParts {
  const ServoLoop& servo;
  const HapticDevice& device;
  const ForceWatch& forces;
  const RecordingControl& recording;
  const MemoryBudget& budget;
  std::uint64_t budget_bytes;
  std::function<std::size_t()> volume_streams;  // subscribers of the volume
};

// Reads the state of the daemon when Prometheus asks for the metrics: process, memory, forces,
// recording, device.
//
// Threads: Collect on any ordinary thread. Ownership: borrows all parts.
class StateMetrics final : public prometheus::Collectable {
 public:
  explicit StateMetrics(MeasuredParts parts) : parts_(std::move(parts)) {}

  std::vector<prometheus::MetricFamily> Collect() const override;

 private:
  const MeasuredParts parts_;
};

}  // namespace palpate
