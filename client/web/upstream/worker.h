// Work that waits for answers of palpated or NATS, on a thread of its own.
//
// Work of a key replaces work of the same key that still waits. Threads: Put on any; work runs on
// the worker's thread, replaced work on that of Put.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace palpate::web {

// On the worker's thread; one line. Work that throws ends nothing but itself.
using WorkFailed = std::function<void(const std::string& why)>;

class Worker {
 public:
  // Called once: to do the work, or because newer work replaced it.
  using Work = std::function<void(bool is_replaced)>;

  explicit Worker(WorkFailed failed = {})
      : failed_(std::move(failed)), thread_([this] { Run(); }) {}
  // Waits for the work that runs. Other work is dropped.
  ~Worker();
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  // Replacing work takes the place of what it replaces.
  void Put(const std::string& key, Work work) { Add(key, std::move(work), false); }
  // Replacing work goes last: for work of several keys that has to be done in the order of Put.
  void PutLast(const std::string& key, Work work) { Add(key, std::move(work), true); }

 private:
  void Add(const std::string& key, Work work, bool goes_last);
  void Run();

  const WorkFailed failed_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false;
  std::vector<std::pair<std::string, Work>> waiting_;  // oldest first
  std::thread thread_;
};

}  // namespace palpate::web
