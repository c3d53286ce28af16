// Ends a filter of OpenVDB by an exception. Asks `cancelled` only every 20 ms, because reading the
// clock is cheaper.
//
// Threads: one. Not for real-time code. Ownership: borrows. Errors: Error (kCancelled).
#pragma once

#include <openvdb/util/NullInterrupter.h>

#include <chrono>
#include <functional>

#include "common/error/error.h"

namespace palpate {

class FilterInterrupter final : public openvdb::util::NullInterrupter {
 public:
  explicit FilterInterrupter(const std::function<bool()>& cancelled) : cancelled_(cancelled) {}

  void Check() {
    if (cancelled_()) throw Error(ErrorKind::kCancelled, "the filter was cancelled");
    asked_ = Clock::now();
  }
  // OpenVDB calls this for every leaf and pass.
  bool wasInterrupted(int = -1) override {
    if (Clock::now() - asked_ > std::chrono::milliseconds(20)) Check();
    return false;
  }

 private:
  using Clock = std::chrono::steady_clock;

  const std::function<bool()>& cancelled_;
  Clock::time_point asked_{};
};

}  // namespace palpate
