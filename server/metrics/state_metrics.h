// Reads the state of the daemon when Prometheus asks for the metrics: process, memory, forces,
// recording, device.
//
// Threads: Collect on any ordinary thread. Ownership: borrows all parts.
#pragma once

#include <prometheus/collectable.h>

#include <functional>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/live_volume/memory_budget.h"
#include "server/pump/force_watch.h"
#include "server/recording/recording_control.h"
#include "server/servo/servo_loop.h"

namespace palpate {

struct MeasuredParts {
  const ServoLoop& servo;
  const HapticDevice& device;
  const ForceWatch& forces;
  const RecordingControl& recording;
  const MemoryBudget& budget;
  std::uint64_t budget_bytes;
  std::function<std::size_t()> volume_streams;  // subscribers of the volume
};

class StateMetrics final : public prometheus::Collectable {
 public:
  explicit StateMetrics(MeasuredParts parts) : parts_(std::move(parts)) {}

  std::vector<prometheus::MetricFamily> Collect() const override;

 private:
  const MeasuredParts parts_;
};

}  // namespace palpate
