// Which refusals are worth a line of the log: a flood of them must not fill it, nor
// hide those of other peers.
//
// Each address gets twenty lines at once and then one every ten seconds, which says how
// many were left out. Beyond some hundreds of addresses the others share one budget.
// Threads: any.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "server/security/rate_limit.h"

namespace palpate {

class RefusalLog {
 public:
  static constexpr std::size_t kMostPeers = 256;

  // `peer`: as gRPC names it, "ipv4:10.0.0.7:51312". The number of refusals of that
  // address that were left out since the last line; none: this one is left out too.
  std::optional<std::uint64_t> Take(const std::string& peer, std::int64_t now_ns);

 private:
  struct Budget {
    RateLimit lines{0.1, 20.0};
    std::uint64_t left_out = 0;
    std::int64_t last_ns = 0;
  };

  std::mutex mutex_;
  std::map<std::string, Budget> budgets_;
};

// The address without the port, which is another at each connection.
std::string AddressOf(const std::string& peer);

}  // namespace palpate
