// Threads for the work of calls.
//
// gRPC's own threads only carry messages: they never wait for a client or for work. A thread here
// is free again when the answer is given to gRPC, so a client that does not read its answers holds
// none. The calls of each method have threads of their own, so that slow ones, such as edits,
// delay no others. A thread starts when it is needed, and stays. If the system allows no first one,
// the work is done on the caller's.
//
// Threads: any.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string_view>
#include <thread>
#include <vector>

#include "server/realtime/thread_setup.h"

namespace palpate {

class CallThreads {
 public:
  // More calls of the method wait, in their order.
  static constexpr std::size_t kMostOfOneMethod = 8;

  CallThreads();
  // Does all work that waits first.
  ~CallThreads();
  CallThreads(const CallThreads&) = delete;
  CallThreads& operator=(const CallThreads&) = delete;

  // method: a call or a transfer of MethodRules.
  void Run(std::string_view method, std::function<void()> work);

 private:
  struct Lane {
    std::deque<std::function<void()>> waiting{};
    std::size_t idle = 0;
    std::condition_variable changed{};
    std::vector<std::thread> threads{};
  };

  void Serve(Lane& lane);

  std::mutex mutex_;
  std::map<std::string_view, Lane> lanes_;  // by methods; does not change
  bool ends_ = false;
  const int nice_ = ThreadNice();
};

}  // namespace palpate
