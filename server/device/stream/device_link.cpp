#include "server/device/stream/device_link.h"

#include <pthread.h>

#include <utility>

#include "server/realtime/thread_setup.h"

namespace palpate {

void DeviceLink::Start(DeviceLog& log, std::function<std::chrono::milliseconds()> connect) {
  if (is_started()) return;
  stop_ = done_ = false;
  thread_ = std::thread([this, &log, connect = std::move(connect)] {
    SetUpThread(log);
    while (!Wait(connect())) {
    }
    const std::lock_guard lock(mutex_);
    done_ = true;
    wake_.notify_all();
  });
}

void DeviceLink::SetUpThread(DeviceLog& log) const {
  pthread_setname_np(pthread_self(), name_.c_str());
  if (priority_ == 0) return;
  RealtimeGrant grant;
  SetupRealtimeThread({.priority = priority_, .cpu = -1, .lock_memory = false}, grant);
  for (const std::string& warning : grant.warnings) log.Add(DeviceEvent::Level::kWarning, warning);
}

bool DeviceLink::Stop(std::chrono::milliseconds longest) noexcept {
  if (!is_started()) return true;
  std::unique_lock lock(mutex_);
  stop_ = true;
  wake_.notify_all();
  const bool has_ended = wake_.wait_for(lock, longest, [this] { return done_; });
  lock.unlock();
  has_ended ? thread_.join() : thread_.detach();
  return has_ended;
}

bool DeviceLink::Wait(std::chrono::milliseconds longest) {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, longest, [this] { return stop_.load(); });
}

}  // namespace palpate
