#include "server/app/device_monitor.h"

#include <chrono>
#include <utility>

#include "common/contract/enumerations.h"
#include "server/log/log.h"

namespace palpate {
namespace {

constexpr std::chrono::milliseconds kPeriod(20);
constexpr std::uint64_t kPeriodsPerSecond = 50;
// Limits the lines of a device whose state changes all the time.
constexpr int kChangesPerSecond = 10;
constexpr std::int64_t kSecondNs = 1'000'000'000;

void Say(const DeviceEvent& event) {
  switch (event.level) {
    case DeviceEvent::Level::kInfo:
      return LogInfo("{}", event.text);
    case DeviceEvent::Level::kWarning:
      return LogWarning("{}", event.text);
    case DeviceEvent::Level::kError:
      return LogError("{}", event.text);
  }
}

}  // namespace

void DeviceMonitor::Start() {
  thread_ = std::thread([this] { Run(); });
}

void DeviceMonitor::Stop() noexcept {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void DeviceMonitor::OnSample(const TickSample& sample) {
  if (sample.force_state == state_ && sample.force_reason == reason_) return;
  state_ = sample.force_state;
  reason_ = sample.force_reason;
  const std::lock_guard lock(mutex_);
  if (sample.time_ns - second_ns_ > kSecondNs) {
    second_ns_ = sample.time_ns;
    changes_of_second_ = 0;
  }
  if (++changes_of_second_ <= kChangesPerSecond) {
    changes_.push_back({state_, reason_, sample.tick});
  } else {
    ++unsaid_changes_;
    last_unsaid_ = {state_, reason_, sample.tick};
  }
}

void DeviceMonitor::Run() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    wake_.wait_for(lock, kPeriod, [this] { return stop_; });
    lock.unlock();
    Say();
    lock.lock();
  }
  lock.unlock();
  Say();
}

void DeviceMonitor::Say() {
  while (const std::optional<DeviceEvent> event = device_.NextEvent()) palpate::Say(*event);
  std::vector<Change> changes;
  std::uint64_t unsaid = 0;
  Change last{};
  {
    const std::lock_guard lock(mutex_);
    changes.swap(changes_);
    // Reports the left-out changes once a second.
    if (++periods_ % kPeriodsPerSecond == 0 || stop_) unsaid = std::exchange(unsaid_changes_, 0);
    last = last_unsaid_;
  }
  for (const Change& change : changes) Say(change);
  if (unsaid == 0) return;
  LogWarning("forces: {} more changes", unsaid);
  // The last change, above all a fault, is never left out.
  Say(last);
}

void DeviceMonitor::Say(const Change& change) const {
  const bool is_bad = change.state == ForceState::kFault || change.state == ForceState::kStopped;
  const bool stays = change.state == ForceState::kStopped ||
                     (change.state == ForceState::kFault && IsHardware(device_.spec()));
  Log(is_bad ? LogLevel::kWarning : LogLevel::kInfo, "forces: {}{} at tick {}{}",
      NameOf(change.state),
      change.reason == ForceReason::kNone ? std::string()
                                          : fmt::format(" ({})", NameOf(change.reason)),
      change.tick,
      stays ? fmt::format("; they stay off until `palpate device enable {}`", device_.spec().kind)
            : std::string());
}

}  // namespace palpate
