// A thread that connects to the devices of one bus or one library, again and again until the end.
//
// Threads: Start and Stop on the main thread; stopping on any; Wait on the link's own thread.
// Real-time: the thread asks for SCHED_FIFO if it has a priority.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "server/device/stream/device_seat.h"

namespace palpate {

class DeviceLink {
 public:
  static constexpr std::chrono::milliseconds kRetry{500};

  // name: the thread's, at most 15 characters. priority: 1 to 99; 0: ordinary scheduling.
  DeviceLink(std::string name, int priority) : name_(std::move(name)), priority_(priority) {}
  DeviceLink(const DeviceLink&) = delete;
  DeviceLink& operator=(const DeviceLink&) = delete;

  // Calls `connect` on the thread: it looks for the devices, streams until something ends that,
  // lets go of them, and returns the time until the next try. A second Start does nothing. Borrows
  // `log`, which gets what the kernel refused.
  void Start(DeviceLog& log, std::function<std::chrono::milliseconds()> connect);
  // Ends the thread. Returns false if it did not end in time: it then goes on by itself, and all
  // that it uses, and this link, must stay.
  bool Stop(std::chrono::milliseconds longest) noexcept;

  bool is_started() const { return thread_.joinable(); }
  const std::atomic<bool>& stopping() const { return stop_; }
  // Waits. Returns true at once if the thread is to end.
  bool Wait(std::chrono::milliseconds longest);

 private:
  void SetUpThread(DeviceLog& log) const;

  const std::string name_;
  const int priority_;
  std::mutex mutex_;  // guards done_, and that nobody misses stop_
  std::condition_variable wake_;
  std::atomic<bool> stop_{false};
  bool done_ = false;
  std::thread thread_;
};

}  // namespace palpate
