// What a callback was told, kept for another thread.
#pragma once

#include <functional>
#include <mutex>
#include <vector>

namespace palpate::test {

template <typename Told>
class Heard {
 public:
  std::function<void(const Told&)> Callback() {
    return [this](const Told& told) {
      const std::lock_guard lock(mutex_);
      all_.push_back(told);
    };
  }
  std::vector<Told> all() const {
    const std::lock_guard lock(mutex_);
    return all_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<Told> all_;
};

}  // namespace palpate::test
