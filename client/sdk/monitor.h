// The state of the connection. All threads of a client can read it and wait for it.
//
// Threads: any.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <string>
#include <utility>

#include "client/sdk/connection.h"

namespace palpate::client {

class Monitor {
 public:
  Connection connection() const {
    const std::lock_guard lock(mutex_);
    return connection_;
  }
  // How often the client has connected so far. Values from another epoch are void.
  std::uint64_t epoch() const {
    const std::lock_guard lock(mutex_);
    return epoch_;
  }
  bool IsConnected(std::uint64_t epoch) const {
    const std::lock_guard lock(mutex_);
    return epoch_ == epoch && IsUp();
  }
  bool stopping() const {
    const std::lock_guard lock(mutex_);
    return stopping_;
  }

  // Returns false if nothing changed.
  bool Set(Connection connection) {
    {
      const std::lock_guard lock(mutex_);
      if (connection.state == connection_.state && connection.why == connection_.why) return false;
      if (connection.state == ConnectionState::kConnected) ++epoch_;
      connection_ = std::move(connection);
    }
    changed_.notify_all();
    return true;
  }
  void Stop() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
  }

  // Waits until connected and returns the epoch; 0 after `timeout` or Stop.
  std::uint64_t WaitUntilConnected(std::chrono::milliseconds timeout) const {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, timeout, [this] { return stopping_ || IsUp(); });
    return !stopping_ && IsUp() ? epoch_ : 0;
  }
  // Sleeps for the duration, or until Stop.
  void Pause(std::chrono::milliseconds duration) const {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, duration, [this] { return stopping_; });
  }

 private:
  bool IsUp() const { return connection_.state == ConnectionState::kConnected; }

  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  Connection connection_;
  std::uint64_t epoch_ = 0;
  bool stopping_ = false;
};

}  // namespace palpate::client
