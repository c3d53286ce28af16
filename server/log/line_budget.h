// Decides which lines about clients are logged: no flood may fill the log, nor hide lines about
// other known clients.
//
// Each address or identity gets twenty lines at once and then one every ten seconds. Each line says
// how many were left out. Above kMostClients, the further ones share one budget.
// Threads: any.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace palpate {

// A token bucket: limits events per second, and the number of events at once.
//
// Threads: one, or the caller's lock.
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

class LineBudget {
 public:
  static constexpr std::size_t kMostClients = 256;

  // `whose`: an identity, or a peer as gRPC names it ("ipv4:10.0.0.7:51312"), whose port makes no
  // difference. Returns how many lines were left out since the last one; none if this line is left
  // out, too.
  std::optional<std::uint64_t> Take(const std::string& whose, std::int64_t now_ns);

 private:
  struct Budget {
    RateLimit lines{0.1, 20.0};
    std::uint64_t left_out = 0;
    std::int64_t last_ns = 0;
  };

  std::mutex mutex_;
  std::map<std::string, Budget> budgets_;
};

// The address without the port, which changes with each connection.
std::string AddressOf(const std::string& peer);

}  // namespace palpate
