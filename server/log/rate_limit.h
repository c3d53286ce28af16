// A token bucket: limits events per second, and the number of events at once.
//
// Threads: one, or the caller's lock.
#pragma once

#include <algorithm>
#include <cstdint>

namespace palpate {

class RateLimit {
 public:
  // Starts full. `most`: the most events at once.
  RateLimit(double rate_per_s, double most) : rate_per_s_(rate_per_s), most_(most), left_(most) {}

  // Takes one event at `now_ns` of a monotonic clock. False if there are too many.
  bool Take(std::int64_t now_ns) {
    if (last_ns_ != 0 && now_ns > last_ns_) {
      left_ = std::min(most_, left_ + static_cast<double>(now_ns - last_ns_) * 1e-9 * rate_per_s_);
    }
    last_ns_ = std::max(last_ns_, now_ns);
    if (left_ < 1.0) return false;
    left_ -= 1.0;
    return true;
  }

 private:
  double rate_per_s_;
  double most_;
  double left_;
  std::int64_t last_ns_ = 0;
};

}  // namespace palpate
