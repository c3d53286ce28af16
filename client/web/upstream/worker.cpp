#include "client/web/upstream/worker.h"

#include <algorithm>
#include <exception>

namespace palpate::web {

Worker::~Worker() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void Worker::Add(const std::string& key, Work work, bool goes_last) {
  {
    const std::lock_guard lock(mutex_);
    const auto same = std::find_if(waiting_.begin(), waiting_.end(),
                                   [&](const auto& one) { return one.first == key; });
    if (same == waiting_.end()) {
      waiting_.emplace_back(key, std::exchange(work, {}));
    } else {
      std::swap(same->second, work);
      if (goes_last) std::rotate(same, same + 1, waiting_.end());
    }
  }
  wake_.notify_all();
  if (work) work(true);
}

void Worker::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
    if (stopping_) return;
    const Work work = std::move(waiting_.front().second);
    waiting_.erase(waiting_.begin());
    lock.unlock();
    try {
      work(false);
    } catch (const std::exception& error) {
      if (failed_) failed_(error.what());
    }
    lock.lock();
  }
}

}  // namespace palpate::web
