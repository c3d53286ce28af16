// Decides which refusals are logged: a flood of refusals must not fill the log, nor hide refusals
// of other peers.
//
// Each address gets twenty lines at once and then one every ten seconds. Each line says how many
// were left out. Above kMostPeers addresses, the further addresses share one budget.
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

  // `peer`: as gRPC names it, "ipv4:10.0.0.7:51312". Returns the number of refusals of this address
  // left out since its last line; none if this refusal is left out, too.
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

// " (and 3 more since)"; empty for none.
std::string LeftOutInWords(std::uint64_t lines);

// The address without the port, which changes with each connection.
std::string AddressOf(const std::string& peer);

}  // namespace palpate
