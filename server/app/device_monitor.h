// Logs what the device and the safety stage do.
//
// Threads: OnSample runs on the pump thread and does not block it. A thread of its own writes the
// log.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/pump/pump.h"

namespace palpate {

class DeviceMonitor final : public SampleSink {
 public:
  // Borrows the device.
  explicit DeviceMonitor(HapticDevice& device) : device_(device) {}
  ~DeviceMonitor() override { Stop(); }

  void Start();
  // Logs what is still to be logged, then joins the thread.
  void Stop() noexcept;

  void OnSample(const TickSample& sample) override;

 private:
  struct Change {
    ForceState state;
    ForceReason reason;
    std::uint64_t tick;
    bool operator==(const Change&) const = default;
  };

  void Run();
  void Say();
  void Say(const Change& change) const;

  HapticDevice& device_;
  // Used by the pump thread only. Initially the state of a servo that has not ticked.
  ForceState state_ = ForceState::kOff;
  ForceReason reason_ = ForceReason::kOperator;
  std::int64_t second_ns_ = 0;
  int changes_of_second_ = 0;

  std::mutex mutex_;  // guards what follows, briefly
  std::condition_variable wake_;
  std::vector<Change> changes_;
  std::uint64_t unsaid_changes_ = 0;
  Change last_unsaid_{};
  std::uint64_t periods_ = 0;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
