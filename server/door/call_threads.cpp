#include "server/door/call_threads.h"

#include <pthread.h>

#include <system_error>
#include <utility>

#include "server/security/methods.h"

namespace palpate {

CallThreads::CallThreads() {
  for (const MethodRule& rule : MethodRules()) {
    const bool is_call = rule.kind == CallKind::kCall || rule.kind == CallKind::kQuestion;
    if (is_call || rule.kind == CallKind::kTransfer) lanes_[rule.method];
  }
}

CallThreads::~CallThreads() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  for (auto& [method, lane] : lanes_) {
    lane.changed.notify_all();
    for (std::thread& thread : lane.threads) thread.join();
  }
}

void CallThreads::Run(std::string_view method, std::function<void()> work) {
  {
    const std::lock_guard lock(mutex_);
    Lane& lane = lanes_.at(method);
    const bool is_full = lane.threads.size() == kMostOfOneMethod;
    try {
      if (lane.waiting.size() >= lane.idle && !is_full) {
        lane.threads.emplace_back([this, &lane] { Serve(lane); });
      }
    } catch (const std::system_error&) {
      // The system allows no more threads.
    }
    if (!lane.threads.empty()) {
      lane.waiting.push_back(std::move(work));
      lane.changed.notify_one();
      return;
    }
  }
  work();
}

void CallThreads::Serve(Lane& lane) {
  pthread_setname_np(pthread_self(), "palpate-call");
  SetThreadNice(nice_);  // a thread of gRPC's may have started this one
  std::unique_lock lock(mutex_);
  while (true) {
    ++lane.idle;
    lane.changed.wait(lock, [&] { return ends_ || !lane.waiting.empty(); });
    --lane.idle;
    if (lane.waiting.empty()) return;
    const std::function<void()> work = std::move(lane.waiting.front());
    lane.waiting.pop_front();
    lock.unlock();
    work();
    lock.lock();
  }
}

}  // namespace palpate
